"""A diagnosis with an accelerometer beside the wrench: one posterior over both."""

import numpy as np
import pytest

from plain_ur5 import PlainUr5
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.diagnose import diagnose

TILT = "base.tilt"
SMALL, LARGE = (2.1e-3, -1.6e-3), (0.014, -0.0105)
"""Tilts about x and y [rad]: 0.15° and 1.0°."""


def answer(robot: PlainUr5, seed: int):
    return diagnose(robot.recording(seed)).diagnosis


def causes(found) -> dict[str, dict]:
    return {w["effect"]: w["parameters"] for w in found.which}


def off(parameters, **truth) -> float:
    """Largest error in standard uncertainties."""
    return max(abs(parameters[k]["value"] - v) / parameters[k]["std"] for k, v in truth.items())


@pytest.mark.sampled
@pytest.mark.parametrize("seed", [0, 1])
def test_a_small_tilt_that_the_accelerometer_proves_is_claimed(seed):
    """The wrench alone shows a gap of 0.2 and names nothing."""
    found = answer(PlainUr5(tilt=SMALL), seed)
    assert (found.verdict, list(causes(found))) == ("identified", [TILT])
    assert found.which[0]["probability"] > 0.99
    assert off(causes(found)[TILT], x=SMALL[0], y=SMALL[1]) < 3.0
    assert all(causes(found)[TILT][k]["std"] < np.deg2rad(0.02) for k in "xy")
    assert any("upheld by the accelerometer" in note for note in found.notes)


@pytest.mark.sampled
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("bent", [0.005, 0.001])
def test_imperfections_of_an_accelerometer_are_no_cause(seed, bent):
    found = answer(PlainUr5(bent=bent, noise=0.005), seed)
    assert (found.verdict, found.which, found.minor) == ("none", [], [])


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_a_bent_accelerometer_still_measures_a_tilt(seed):
    found = answer(PlainUr5(tilt=(0.007, -0.005), bent=0.005, noise=0.005), seed)
    assert list(causes(found)) == [TILT]
    assert off(causes(found)[TILT], x=0.007, y=-0.005) < 3.0


@pytest.mark.sampled
@pytest.mark.parametrize("seed", [0, 1])
def test_a_tilt_that_the_wrench_contradicts_is_not_claimed(seed):
    """A pull that hides it exactly would be a conspiracy."""
    found = answer(PlainUr5(tilt_of_accelerometer=LARGE), seed)
    assert (found.verdict, found.which, found.minor) == ("none", [], [])


@pytest.mark.sampled
@pytest.mark.parametrize("seed", [0, 1])
def test_a_tilt_that_the_accelerometer_contradicts_is_not_claimed(seed):
    """A constant force in the world does the same to the wrench alone."""
    found = answer(PlainUr5(tilt=LARGE, tilt_of_accelerometer=(0.0, 0.0)), seed)
    assert TILT not in causes(found)
    assert TILT not in {r["effect"] for w in found.which for r in w["rivals"]}


@pytest.mark.slow
def test_what_moves_the_arm_speaks_through_both():
    """The zero of joint 5: the wrench alone shows a gap of 0.4."""
    truth = np.deg2rad(0.3)
    found = answer(PlainUr5(offset=(0.0, 0.0, 0.0, 0.0, truth, 0.0)), 0)
    assert list(causes(found)) == ["joint.offset"]
    assert found.which[0]["elements"] == ["joint 5"]
    assert off(causes(found)["joint.offset"], **{"offset.q5": truth}) < 3.0


@pytest.mark.slow
def test_without_the_accelerometer_nothing_is_named():
    full = PlainUr5(tilt=SMALL).recording(0)
    bare = {k: v for k, v in full.columns.items() if k not in ("ax", "ay", "az")}
    found = diagnose(Recording(full.metadata, bare, full.name)).diagnosis
    assert (found.verdict, found.which) == ("none", [])
