"""What an earlier fit states of the drives: its tool goes with them."""

import pytest
from arm_gaps import Gap, case, unstated

from wrenchbed.diagnosis.efforts.diagnose_efforts import diagnose_efforts
from wrenchbed.drives.identify import calibrate_efforts

LOAD = 0.9
"""Payload that only the second recording has [kg]."""


def test_a_load_that_the_earlier_fit_had_not_is_named(tmp_path):
    healthy = calibrate_efforts(unstated(case(seed=5, configured=False)))
    path = tmp_path / "healthy.json"
    healthy.write(path)
    loaded = unstated(case(Gap("tool.mass", size=LOAD), seed=6, configured=False))
    answer = diagnose_efforts(loaded, drives=path).diagnosis.to_json()
    (cause,) = answer["which"]
    assert cause["effect"] == "tool.mass"
    mass = cause["parameters"]["mass"]
    assert mass["value"] == pytest.approx(LOAD, abs=max(0.02, 3.0 * mass["std"]))
    assert "tool.mass" not in {f["name"] for f in answer["fitted"]}
    without = diagnose_efforts(loaded).diagnosis.to_json()
    fitted = {f["name"]: f for f in without["fitted"]}
    assert "tool.mass" not in {w["effect"] for w in without["which"]}
    assert fitted["tool.mass"]["stated"] is None
    assert fitted["drive.coulomb.2"]["unit"] == "N·m"
