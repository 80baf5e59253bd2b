"""Fields of JSON and TOML: what is wrong is named by file, field, value and rule."""

import pytest

from wrenchbed.errors import MapError, TwinError
from wrenchbed.files.checked import Fields, load


def fields(**raw):
    return Fields(raw, "a.json: ", MapError)


@pytest.mark.parametrize(
    ("read", "message"),
    [
        (lambda: fields(x="1").number("x", "kg"), "a.json: x = '1' must be a number [kg]"),
        (lambda: fields(x=True).number("x", "kg"), "x = True must be a number"),
        (lambda: fields(x=float("nan")).number("x", "s"), "x = nan must be a number"),
        (lambda: fields(x=10**400).number("x", "s"), "must be a number [s]"),
        (lambda: fields(x=0).number("x", "s", positive=True), "x = 0 must be above 0 s"),
        (lambda: fields(x=-1).number("x", "s", nonnegative=True), "must be at least 0 s"),
        (lambda: fields(x=[1, 2]).numbers("x", 3), "x = [1, 2] must be 3 finite numbers"),
        (lambda: fields(x=[1, "2"]).numbers("x", 2), "must be 2 finite numbers"),
        (lambda: fields().stated_text("x"), "x is missing: it must be a text"),
        (lambda: fields(x=3).text("x"), "x = 3 must be a name"),
        (lambda: fields(x="c").choice("x", ("a", "b"), "must be a or b"), "x = 'c' must be a or b"),
        (lambda: fields(x=3).part("x"), "a.json: x is not an object with fields"),
        (lambda: fields(x={"y": 0}).part("x").text("y"), "x.y = 0 must be a name"),
        (lambda: fields(x=[{}, 1]).parts("x"), "x[1] is not an object with fields"),
        (lambda: fields(x=1).only(("b", "a"), "a map"), "there is no field x; a map has a, b"),
        (lambda: Fields([], "a.json: ", MapError), "a.json: the file is not an object with fields"),
    ],
)
def test_a_wrong_field_is_named_with_its_rule(read, message):
    with pytest.raises(MapError) as error:
        read()
    assert message in str(error.value)


def test_right_fields_are_read():
    f = fields(a=1, b=[1, 2.5], c="x", d={"e": 2}, l=[{"m": 1}])
    assert (f.number("a", "m"), f.numbers("b", 2), f.text("c")) == (1.0, (1.0, 2.5), "x")
    assert f.part("d").number("e", "m") == 2.0
    assert [p.raw for p in f.parts("l")] == [{"m": 1}]
    assert (f.number("z", "m"), f.numbers("z", 3), f.text("z"), f.part("z").raw) == (
        None, None, None, {},
    )  # fmt: skip


def test_an_error_inside_names_the_field():
    with pytest.raises(MapError, match="a.json: x: other"), fields().naming("x"):
        raise TwinError("other")


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.json", "{", "not valid JSON"),
        ("a.toml", "[", "not valid TOML"),
        ("a.txt", "[", "not valid TOML"),
        ("a.json", "[" * 100_000, "not valid JSON"),
    ],
)
def test_a_broken_file_is_named(tmp_path, name, text, message):
    (tmp_path / name).write_text(text)
    with pytest.raises(MapError, match=f"{name}: {message}"):
        load(tmp_path / name, MapError, "TOML")


def test_a_missing_file_and_a_folder_are_named(tmp_path):
    with pytest.raises(TwinError, match="there is no such file"):
        load(tmp_path / "a.json", TwinError)
    with pytest.raises(TwinError, match="is a folder; give a JSON file"):
        load(tmp_path, TwinError)


def test_a_recording_where_json_is_wanted_is_called_so(tmp_path):
    (tmp_path / "rec.json").write_bytes(b"PAR1\x80\x00PAR1")
    with pytest.raises(TwinError, match=r"rec\.json: is Parquet, such as recordings"):
        load(tmp_path / "rec.json", TwinError)
