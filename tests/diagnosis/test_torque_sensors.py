"""Zero or gain of one joint's torque sensor: joint and value, by MuJoCo's torques and numpy."""

from dataclasses import replace

import numpy as np
import pytest
from rest_torques import REAL, TOOL, recording, ur5

from wrenchbed.channels.effort import CHANNEL
from wrenchbed.channels.response import readings
from wrenchbed.diagnosis.diagnose import diagnose
from wrenchbed.effects.chain import ActiveEffect
from wrenchbed.effects.scene import Scene

UR5 = ur5()


def broken(rec, joint, gain=0.0, zero=0.0):
    """A recording in which one sensor reads (1 + gain) τ + zero."""
    name = f"tau{joint}"
    return replace(rec, columns=dict(rec.columns) | {name: (1.0 + gain) * rec.columns[name] + zero})


def check(found, effect, name, joint, truth):
    """One cause in its joint, its value within 3 standard uncertainties."""
    (only,) = found.which
    assert only["effect"] == effect and only["elements"] == [f"joint {joint}"]
    assert only["parameters"]["joint"]["value"] == joint
    number = only["parameters"][name]
    assert abs(number["value"] - truth) < 3.0 * number["std"] < abs(truth)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("joint", "gain", "zero"),
    [(4, 0.0, 4.0), (3, -0.2, 0.0), (1, 0.0, 3.0), (2, 0.0, -8.0), (5, 0.0, 1.0), (6, 0.0, 0.5),
     (2, 0.15, 0.0), (4, 0.3, 0.0)],
)  # fmt: skip
@pytest.mark.parametrize("seed", range(3))
def test_at_rest_a_wrong_sensor_is_named_with_its_value(seed, joint, gain, zero):
    d = diagnose(broken(recording(UR5, seed, TOOL, wrong=REAL), joint, gain, zero)).diagnosis
    effect, name = ("drive.constant", "gain") if gain else ("drive.offset", "offset")
    check(d, effect, f"{name}.q{joint}", joint, gain or zero)


@pytest.mark.slow
def test_at_rest_a_gain_without_weight_on_its_joint_is_blind():
    d = diagnose(broken(recording(UR5, 7, TOOL, wrong=REAL), 1, 0.3)).diagnosis
    assert d.verdict == "none"
    blind = {(s.effect, s.element): s.smallest for s in d.blind}
    assert blind["drive.constant", "joint 1"] is None and blind["drive.constant", "joint 3"] < 0.2


@pytest.mark.slow
def test_at_rest_a_sensor_and_a_load_that_read_alike_are_one_class():
    """All poses alike: the zero of a sensor, of its joint, or a load may make such readings."""
    rng = np.random.default_rng([0, 6])
    near = UR5.home + 0.03 * rng.normal(size=(30, 6))
    rec = recording(UR5, 0, TOOL, poses=30, at=near, wrong=REAL)
    (only,) = diagnose(broken(rec, 2, zero=12.0)).diagnosis.which
    names = {only["effect"], *(r["effect"] for r in only["rivals"])}
    assert {"drive.offset", "joint.offset"} <= names
    assert abs(only["parameters"]["offset.q2"]["value"] - 12.0) < 2.0


def test_the_channel_reads_what_the_sensors_make_of_the_torques():
    q = UR5.sample(12, np.random.default_rng(1))
    held, theta = np.ones(12, dtype=bool), UR5.parameters.nominal
    scene = Scene(UR5, theta, np.array(UR5.gravity), q, np.arange(12.0), held)
    true = readings((CHANNEL,), scene)
    active = [
        ActiveEffect.of(UR5, "drive.constant", {"joint": 2, "gain": 0.1}),
        ActiveEffect.of(UR5, "drive.offset", {"joint": 3, "offset": -2.0}),
    ]
    by_hand = true * [1.0, 1.1, 1.0, 1.0, 1.0, 1.0] + [0.0, 0.0, -2.0, 0.0, 0.0, 0.0]
    assert readings((CHANNEL,), scene, active) == pytest.approx(by_hand, abs=1e-12)
