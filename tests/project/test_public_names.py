"""The package's public names: listed once, imported on first use, one home each."""

import ast
import importlib
import inspect
from pathlib import Path

import pytest

import wrenchbed as wb

SOURCE = Path(inspect.getfile(wb))


def test_dir_lists_the_public_names_alone():
    listed = {name for name in dir(wb) if not (name.startswith("__") and name.endswith("__"))}
    assert listed | {"__version__"} == set(wb.__all__)
    assert wb.__all__ == sorted(wb.__all__)


@pytest.mark.parametrize("name", wb.__all__)
def test_every_public_name_can_be_imported_and_is_documented(name):
    value = getattr(wb, name)
    assert isinstance(value, str) or inspect.getdoc(value)


def test_type_checkers_see_the_same_names_at_the_same_places():
    block = next(n for n in ast.parse(SOURCE.read_text()).body if isinstance(n, ast.If))
    seen = {"__version__"}
    for node in (n for n in block.body if isinstance(n, ast.ImportFrom)):
        for alias in node.names:
            seen.add(public := alias.asname.removeprefix("_"))
            module = importlib.import_module(node.module)
            assert getattr(wb, public) is getattr(module, alias.name)
    assert seen == set(wb.__all__)


def test_an_unknown_name_is_refused():
    with pytest.raises(AttributeError, match="no attribute 'wrench_bed'"):
        wb.wrench_bed  # noqa: B018


def test_no_room_has_the_name_of_a_function():
    rooms = {p.stem for p in SOURCE.parent.iterdir()}
    assert not rooms & set(wb.__all__)
