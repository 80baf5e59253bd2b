"""A diagnosis with a tracker beside the wrench: what one cannot tell, the other may."""

import numpy as np
import pytest

from plain_ur5 import PlainUr5
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.diagnose import diagnose


def with_zero_off(joint: int, degrees: float = 0.3) -> PlainUr5:
    offset = np.zeros(6)
    offset[joint - 1] = np.deg2rad(degrees)
    return PlainUr5(offset=tuple(offset), tracked=5e-5)


def without(recording: Recording, *columns: str) -> Recording:
    kept = {k: v for k, v in recording.columns.items() if k not in columns}
    return Recording(recording.metadata, kept, recording.name)


@pytest.mark.parametrize(
    ("joint", "seed"),
    [(3, 0), *(pytest.param(j, s, marks=pytest.mark.slow) for j in (2, 3, 4) for s in (1, 2))],
)
def test_zeros_of_parallel_joints_are_told_apart(joint, seed):
    recording = without(with_zero_off(joint).recording(seed), "ax", "ay", "az")
    found = diagnose(recording).diagnosis
    assert [w["effect"] for w in found.which] == ["joint.offset"]
    assert found.which[0]["elements"] == [f"joint {joint}"]
    value = found.which[0]["parameters"][f"offset.q{joint}"]
    assert abs(value["value"] - np.deg2rad(0.3)) < 3.0 * value["std"]


@pytest.mark.slow
def test_the_wrench_alone_knows_their_sum():
    recording = without(with_zero_off(3, 0.6).recording(0), "ax", "ay", "az", "mx", "my", "mz")
    found = diagnose(recording).diagnosis
    assert set(found.which[0]["elements"]) == {"joint 2", "joint 3", "joint 4"}


def test_a_healthy_robot_has_no_cause():
    found = diagnose(without(PlainUr5(tracked=5e-5).recording(0), "ax", "ay", "az")).diagnosis
    assert (found.verdict, found.which, found.minor) == ("none", [], [])
