"""Diagnosis of joint torques: one cause each, simulated by other code, is named in its joint."""

import json

import numpy as np
import pytest
from arm_gaps import Gap, case
from arm_torques import COULOMB, NOISE

from wrenchbed.cli import main
from wrenchbed.diagnosis.efforts.diagnose_efforts import diagnose_efforts
from wrenchbed.diagnosis.gap.result import named_by
from wrenchbed.reports.effort_answer import EffortAnswer


def consistent(found):
    """The contract's invariants."""
    d, raw = found.diagnosis, found.diagnosis.to_json()
    g = d.gap
    assert sum(d.probabilities.values()) == pytest.approx(1.0, abs=1e-9)
    assert (d.verdict in ("none", "unknown")) == (not d.which)
    if d.verdict == "none":
        assert g.calibrated.low <= 1.0
    for w in d.which:
        assert 0.0 <= w["probability"] <= 1.0
        if w["probability"] > 0.5:
            assert g.closed.low > 0.0 or d.verdict == "partial"
    assert json.loads(json.dumps(raw))["verdict"] == d.verdict
    assert d.verdict == "partial" or EffortAnswer(found).headline


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("effect", "joint", "size"),
    [("drive.coulomb", 2, 8.0), ("drive.load", 4, 6.0), ("drive.constant", 3, 8.0),
     ("drive.cogging", 2, 6.0)],
)  # fmt: skip
def test_a_cause_is_named_in_its_joint(effect, joint, size):
    found = diagnose_efforts(case(Gap(effect, joint, size), seed=20 + joint))
    consistent(found)
    d = found.diagnosis
    assert d.verdict in ("identified", "ambiguous")
    assert d.which[0]["effect"] == effect and d.which[0]["parameters"]["joint"]["value"] == joint
    assert d.gap.closed.value > 0.6


@pytest.mark.slow
def test_hysteresis_is_one_cause_with_the_friction_that_it_adds(tmp_path):
    size = 6.0
    found = diagnose_efforts(case(Gap("gear hysteresis", 2, size), seed=22))
    consistent(found)
    (only,) = found.diagnosis.which
    assert only["effect"] == "drive.hysteresis" and not only["rivals"]
    assert only["parameters"]["joint"]["value"] == 2
    assert only["parameters"]["size"]["value"] == pytest.approx(size * NOISE[1], rel=0.2)
    assert found.diagnosis.gap.closed.value > 0.9
    found.write(tmp_path)
    drives = json.loads((tmp_path / "drives.json").read_text())["configured"]
    assert drives["drive.coulomb.2"] == pytest.approx(COULOMB[1], rel=0.15)


@pytest.mark.slow
def test_friction_that_fades_after_a_reversal_is_no_hysteresis():
    found = diagnose_efforts(case(Gap("breakaway", 2, 12.0), seed=23))
    consistent(found)
    first = found.diagnosis.which[0]
    assert first["effect"] == "drive.stiction" and first["parameters"]["size"]["value"] > 0.0
    assert "drive.hysteresis" not in named_by(first)[1:]


@pytest.mark.slow
def test_a_limited_torque_is_unknown():
    found = diagnose_efforts(case(Gap("clipped", 2, 0.8), seed=32))
    consistent(found)
    assert found.diagnosis.verdict == "unknown" and "limited" in found.outside


@pytest.mark.slow
def test_the_verb_writes_all_files(tmp_path, capsys):
    case(Gap("drive.coulomb", 2, 8.0), seed=5).write(tmp_path / "rec.parquet")
    out = tmp_path / "found"
    assert main(["diagnose", str(tmp_path / "rec.parquet"), "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    raw = json.loads((out / "diagnosis.json").read_text())
    assert raw["verdict"] == "identified" and "drive.coulomb" in shown
    page = (out / "report.html").read_text(encoding="utf-8")
    assert '"joint 2, residual [noise]"' in page and (out / "twin.json").exists()
    made = json.loads((out / "drives.json").read_text())["configured"]
    size = 8.0 * 0.9
    assert made["drive.coulomb.2"] == pytest.approx(9.0 + size, abs=1.0)
    drives = str(out / "drives.json")
    again = ["diagnose", str(tmp_path / "rec.parquet"), "--drives", drives, "--json"]
    assert main([*again, "--out", str(tmp_path / "again")]) == 0
    raw = json.loads(capsys.readouterr().out)
    assert raw["verdict"] == "none" and np.isfinite(raw["gap"]["calibrated"])
