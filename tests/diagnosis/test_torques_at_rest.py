"""Joint torques alone, at rest: the load named, and healthy arms."""

import numpy as np
import pytest
from rest_torques import REAL, TOOL, by_file, recording, ur5

from wrenchbed.cli import main
from wrenchbed.diagnosis.diagnose import diagnose


@pytest.fixture(scope="module")
def arms(tmp_path_factory):
    return {"ur5": ur5(), "iiwa": by_file(tmp_path_factory.mktemp("iiwa"))}


@pytest.mark.sampled
@pytest.mark.parametrize("arm", ["iiwa", "ur5"])
def test_a_load_beyond_the_stated_one_is_named_and_weighed(arm, arms):
    """1.3 kg at the stated centre; links, sensors and zeros of joints off as in real arms."""
    load = (TOOL[0] + 1.3, TOOL[1])
    d = diagnose(recording(arms[arm], 0, load, wrong=REAL)).diagnosis
    assert d.verdict == "identified" and [w["effect"] for w in d.which] == ["tool.mass"]
    mass = d.which[0]["parameters"]["mass"]
    assert abs(mass["value"] - 1.3) < 3.0 * mass["std"] < 1.0
    assert d.gap.configured > 5.0 and d.gap.calibrated.value < 1.0


def test_a_healthy_arm_is_none_and_says_what_it_could_not_have_shown(arms):
    d = diagnose(recording(arms["ur5"], 1, TOOL, wrong=REAL)).diagnosis
    assert d.verdict == "none" and not d.which
    spots = {(s.effect, s.element): s.smallest for s in d.blind}
    lengths = {s.why for s in d.blind if s.effect == "link.length" and s.element.startswith("a2")}
    assert lengths == {"not sought in joint torques at rest"}  # they carry weight, and so show
    assert spots["joint.offset", "joint 1"] is None  # it turns about gravity
    assert spots["joint.offset", "joint 2"] > np.deg2rad(0.3)


def test_the_command_answers_without_a_wrench(arms, tmp_path, capsys):
    load = (TOOL[0] + 1.0, (0.03, 0.0, 0.09))
    recording(arms["ur5"], 2, load, wrong=REAL).write(tmp_path / "rest.parquet")
    out = tmp_path / "out"
    words = ["diagnose", str(tmp_path / "rest.parquet"), "--channels", "effort", "--out", str(out)]
    assert main(words) == 0
    assert "tool.mass" in capsys.readouterr().out
    assert (out / "diagnosis.json").exists() and (out / "report.html").exists()
