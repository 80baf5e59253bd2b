"""docs/contracts.md and the public names hold: what is listed is what is written and taken."""

import ast
import importlib
import inspect
import json
import re
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pyarrow.parquet as pq
import pytest

import wrenchbed as wb
from wrenchbed.cli import _VERBS, main
from wrenchbed.pages.draw import Drawn

PAGE = (Path(__file__).parents[2] / "docs" / "contracts.md").read_text(encoding="utf-8")
CALIBRATED = {"touches", "target_rms"}
"""Fields of fit.json that only some calibrations have."""


def section(title: str) -> str:
    """Text below a heading, up to the next heading of the same rank or a higher one."""
    rank, start = next(
        (len(m.group(1)), m.end())
        for m in re.finditer(r"^(#+) (.+)$", PAGE, flags=re.MULTILINE)
        if m.group(2) == title
    )
    end = re.search(rf"^#{{1,{rank}}} ", PAGE[start:], flags=re.MULTILINE)
    return PAGE[start : start + end.start()] if end else PAGE[start:]


def table(title: str) -> dict[str, str]:
    """Rows of the first table of a section: first cell → the rest."""
    lines = [x for x in section(title).splitlines() if x.startswith("|")]
    rows = [[c.strip() for c in x.strip("|").split("|", 1)] for x in lines[2:]]
    return dict(rows)


def fields(title: str) -> set[str]:
    """Names in backticks in the first column of a section's table."""
    return {n for first in table(title) for n in re.findall(r"`([^`]+)`", first)}


def example(title: str) -> dict:
    return json.loads(re.search(r"```json\n(.*?)```", section(title), flags=re.DOTALL).group(1))


def made(folder, effect, poses="24", samples="10"):
    """A folder with what the verbs write of one robot with an effect."""
    plan, rec = (str(folder / name) for name in ("plan.parquet", "rec.parquet"))
    assert main(["plan", "ur5", "--n", poses, "--out", plan]) == 0
    line = ["record", "--robot", "ur5", "--plan", plan, "--out", rec, "--samples", samples]
    assert main([*line, "--effect", effect]) == 0
    with patch("wrenchbed.reports.diagnosis_page.draw", lambda c: Drawn(c, "<svg></svg>")):
        assert main(["diagnose", rec, "--out", str(folder / "out")]) == 0
    return folder


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Everything that the verbs write about one robot with a compliant joint."""
    folder = tmp_path_factory.mktemp("contracts")
    made(folder, "joint.compliance:joint=2,stiffness=9000")
    line = ["calibrate", str(folder / "rec.parquet"), "--out", str(folder / "fit.json")]
    assert main(line) == 0
    return folder


def read(path: Path) -> dict:
    return json.loads(path.read_text(encoding="utf-8"))


def test_a_recording_has_the_columns_and_metadata_of_the_page(written):
    schema = pq.read_schema(written / "rec.parquet")
    assert {"t", "fx", "fy", "fz", "tx", "ty", "tz", *(f"q{k}" for k in range(1, 7))} <= {
        *schema.names
    }
    metadata = json.loads(schema.metadata[b"wrenchbed"])
    required = next(first for first in table("Recording: one Parquet file") if "format" in first)
    assert set(re.findall(r"`(\w+)`", required)) <= metadata.keys()
    known = {name.split(".")[0] for name in fields_of_metadata()}
    assert metadata.keys() <= known | {"started", "rate_hz"}


def fields_of_metadata() -> set[str]:
    text = section("Recording: one Parquet file").split("| field |")[1]
    return set(re.findall(r"`([a-z_.]+)`", "\n".join(re.findall(r"^\|([^|]+)\|", text, re.M))))


def test_the_metadata_of_the_page_are_read(written, tmp_path):
    stated = example("Recording: one Parquet file") | {"source": "sim", "mode": "static"}
    rows = pq.read_table(written / "rec.parquet")
    pq.write_table(rows.replace_schema_metadata({"wrenchbed": json.dumps(stated)}), tmp_path / "r")
    metadata = wb.Recording.read(tmp_path / "r").metadata
    assert metadata.tool.mass == 1.35
    assert json.loads(json.dumps(metadata.to_json()))["tolerance"] == stated["tolerance"]


def test_a_plan_has_the_columns_of_the_page(written):
    schema = pq.read_schema(written / "plan.parquet")
    assert {f"q{k}" for k in range(1, 7)} <= {*schema.names}
    assert {"format", "robot"} <= json.loads(schema.metadata[b"wrenchbed"]).keys()


def test_fit_json_has_exactly_the_fields_of_the_page(written):
    assert read(written / "fit.json").keys() | CALIBRATED == fields("fit.json") | CALIBRATED
    one = next(iter(read(written / "fit.json")["parameters"].values()))
    assert one.keys() == {"value", "std", "unit", "nominal", "interval95"}


def test_twin_json_has_exactly_the_fields_of_the_page(written):
    twin = read(written / "out" / "twin.json")
    assert twin.keys() == fields("twin.json")
    assert twin["effects"][0].keys() == {"effect", "parameters"}


def test_diagnosis_json_has_the_fields_of_the_page(written):
    told, page = read(written / "out" / "diagnosis.json"), example("diagnosis.json")
    assert page.keys() == told.keys()
    assert told["gap"].keys() == fields("Gap") == page["gap"].keys()
    assert told["which"][0].keys() == page["which"][0].keys()
    assert told["where"][0].keys() == page["where"][0].keys()
    assert told["verdict"] in page["verdict"].split(" | ")
    assert sum(told["probabilities"].values()) == pytest.approx(1.0, abs=1e-9)
    assert told["which"][0]["parameters"]["stiffness"].keys() == {"value", "std", "unit"}


def test_every_verdict_is_explained():
    known = example("diagnosis.json")["verdict"].split(" | ")
    assert {*known} == fields("Verdicts")


@pytest.mark.slow
def test_a_cause_without_a_formula_has_the_fields_of_the_page(tmp_path):
    drift = "sensor.drift:wave2.fx=0.002,wave3.fx=0.002,wave5.fx=-0.004,duration=279"
    folder = made(tmp_path, drift, "60", "30")
    (entry,) = read(folder / "out" / "diagnosis.json")["which"]
    assert entry["effect"] == "sensor.drift"
    plain = set(example("diagnosis.json")["which"][0])
    page = fields("A cause without a formula")
    assert entry.keys() == plain | page == plain | {"form", "curve"}
    assert entry["form"] == "free"
    keys = re.search(r"`(\{.*?\})`", table("A cause without a formula")["`curve`"]).group(1)
    assert entry["curve"].keys() == set(re.findall(r'"(\w+)":', keys))
    assert len(entry["curve"]["x"]) == len(entry["curve"]["y"]) == len(entry["curve"]["std"])
    assert (entry["curve"]["x_unit"], entry["curve"]["y_unit"]) == ("s", "N")
    size = entry["parameters"]["size.fx"]
    assert abs(size["value"]) == pytest.approx(np.ptp(entry["curve"]["y"]))


def test_the_verbs_are_those_of_the_page():
    named = {re.match(r"`?([\w-]+)", n).group(1) for n in fields("Command line")} - {"report"}
    assert named | {"report"} == {*_VERBS}


@pytest.mark.parametrize("verb", [v for v in _VERBS if v != "blind"])
def test_the_options_that_the_page_names_exist(verb, capsys):
    text = " ".join(f"{a} {b}" for a, b in table("Command line").items() if f"`{verb} " in a)
    if verb in ("record", "twin"):
        text += re.search(rf"`{verb}` also takes ([^.]+)\.", section("Command line")).group(1)
    options = {o for o in re.findall(r"--[a-z-]+", text) if "planned" not in text.split(o)[0][-9:]}
    if verb == "twin":
        options -= {"--quick"}
    if options:
        with pytest.raises(SystemExit):
            main([verb, "--help"])
        usage = capsys.readouterr().out
        assert not {o for o in options if o not in usage}


def test_the_effects_are_those_of_the_page():
    text = section("Effects: names that referees use")
    assert set(re.findall(r"`([a-z]+\.[a-z_]+)`", text)) == {*wb.names("effects")}


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
