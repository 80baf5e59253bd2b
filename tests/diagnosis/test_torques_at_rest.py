"""Joint torques alone, at rest: the load named, and healthy arms."""

import json

import numpy as np
import pytest
from rest_torques import REAL, TOOL, by_file, recording, ur5

from wrenchbed.cli import main
from wrenchbed.diagnosis.diagnose import diagnose
from wrenchbed.pages.draw import Drawn


@pytest.fixture(scope="module")
def arms(tmp_path_factory):
    return {"ur5": ur5(), "iiwa": by_file(tmp_path_factory.mktemp("iiwa"))}


@pytest.mark.sampled
@pytest.mark.parametrize("arm", ["iiwa", "ur5"])
def test_a_load_beyond_the_stated_one_is_named_and_weighed(
    arm, arms, tmp_path, capsys, monkeypatch
):
    """1.3 kg at the stated centre; links, sensors and zeros of joints off as in real arms."""
    monkeypatch.setattr("wrenchbed.reports.diagnosis_page.draw", lambda c: Drawn(c, "<svg></svg>"))
    load, out = (TOOL[0] + 1.3, TOOL[1]), tmp_path / "out"
    recording(arms[arm], 0, load, wrong=REAL).write(tmp_path / "rest.parquet")
    words = ["diagnose", str(tmp_path / "rest.parquet"), "--channels", "effort", "--out", str(out)]
    assert main(words) == 0
    assert "tool.mass" in capsys.readouterr().out and (out / "report.html").exists()
    told = json.loads((out / "diagnosis.json").read_text())
    assert told["verdict"] == "identified"
    assert [w["effect"] for w in told["which"]] == ["tool.mass"]
    mass = told["which"][0]["parameters"]["mass"]
    assert abs(mass["value"] - 1.3) < 3.0 * mass["std"] < 1.0
    assert told["gap"]["configured"] > 5.0 and told["gap"]["calibrated"] < 1.0


def test_a_healthy_arm_is_none_and_says_what_it_could_not_have_shown(arms):
    d = diagnose(recording(arms["ur5"], 1, TOOL, wrong=REAL)).diagnosis
    assert d.verdict == "none" and not d.which
    spots = {(s.effect, s.element): s.smallest for s in d.blind}
    lengths = {s.why for s in d.blind if s.effect == "link.length" and s.element.startswith("a2")}
    assert lengths == {"not sought in joint torques at rest"}  # they carry weight, and so show
    assert spots["joint.offset", "joint 1"] is None  # it turns about gravity
    assert spots["joint.offset", "joint 2"] > np.deg2rad(0.3)
    assert spots["drive.constant", "joint 1"] is None  # no weight acts on it
    assert spots["drive.constant", "joint 3"] < 0.2
