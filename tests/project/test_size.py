"""Budgets of lines. A change that needs more gives something up first (see CONTRIBUTING)."""

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
WRENCHBED = {
    ".": 532,
    "benchmark": 7833,
    "calibration": 5258,
    "campaigns": 1204,
    "channels": 938,
    "cli": 2688,
    "data": 5292,
    "diagnosis": 13000,
    "drives": 1646,
    "effects": 4939,
    "environments": 614,
    "exports": 851,
    "files": 548,
    "hardware": 6806,
    "jobs": 415,
    "monitoring": 1418,
    "pages": 1297,
    "physics": 1038,
    "planning": 1058,
    "plant": 798,
    "reports": 2216,
    "robots": 4522,
    "sensors": 316,
    "simulation": 1349,
    "studies": 1360,
    "twin": 1130,
    "viewer": 821,
}
"""Lines of Python of each room of wrenchbed at most; ``.`` is the package's own files."""
IN_ALL = {
    "src": 78910,
    "src/wrenchbed": 69420,
    "src/robot_emulators": 9490,
    "tests": 39889,
    "scripts": 3481,
}
"""Lines of Python below a folder at most; of scripts every line."""
MOST_FILES = 474
"""Files of Python below src at most."""


def lines(*paths: Path) -> int:
    """Lines of files."""
    return sum(path.read_bytes().count(b"\n") for path in paths)


def test_every_room_has_a_budget():
    rooms = {
        p.name for p in (ROOT / "src" / "wrenchbed").iterdir() if (p / "__init__.py").is_file()
    }
    assert rooms | {"."} == set(WRENCHBED)


@pytest.mark.parametrize("room", WRENCHBED)
def test_a_room_keeps_to_its_budget(room):
    folder = ROOT / "src" / "wrenchbed" / room
    files = folder.glob("*.py") if room == "." else folder.rglob("*.py")
    assert lines(*files) <= WRENCHBED[room]


@pytest.mark.parametrize("folder", IN_ALL)
def test_a_package_keeps_to_its_budget(folder):
    pattern = "*" if folder == "scripts" else "*.py"
    files = [p for p in (ROOT / folder).rglob(pattern) if p.is_file() and p.suffix != ".pyc"]
    assert lines(*files) <= IN_ALL[folder]


def test_files_are_few():
    assert len(list((ROOT / "src").rglob("*.py"))) <= MOST_FILES
