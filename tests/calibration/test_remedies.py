"""A refusal's remedy, followed to the letter, gives the load: a UR5 in plain numpy."""

import re
from dataclasses import replace

import numpy as np
import pytest

from plain_ur5 import COG, GRAVITY, MASS, PlainUr5, flange
from wrenchbed.calibration.calibrate import calibrate
from wrenchbed.calibration.trust import check
from wrenchbed.data.metadata import Metadata, ToolInfo
from wrenchbed.data.recording import Recording
from wrenchbed.errors import CalibrationError
from wrenchbed.physics.wrench import CHANNELS

LBF, LBF_IN = 4.4482216152605, 0.1129848290276167
STATED = ToolInfo(mass=MASS, cog=tuple(COG))


@pytest.fixture(scope="module", params=[0, 1])
def sound(request):
    recording = PlainUr5().recording(request.param)
    wrench = {c: recording.columns[c] for c in CHANNELS}
    columns = {c: x for c, x in recording.columns.items() if c[0] in "tsqft"} | wrench
    return Recording(replace(recording.metadata, tool=STATED), columns, "log.parquet")


def scaled(recording, *factors):
    """The recording with each channel times a factor, or forces and torques times two."""
    each = np.repeat(factors, 3) if len(factors) == 2 else factors
    wrench = {c: f * recording.columns[c] for c, f in zip(CHANNELS, each, strict=True)}
    return Recording(recording.metadata, {**recording.columns, **wrench}, recording.name)


def with_tool(recording, tool):
    return Recording(replace(recording.metadata, tool=tool), recording.columns, recording.name)


def without_payload(recording, mass, cog):
    """What a controller shows that subtracts the weight of a payload, by the load that is there."""
    force = recording.wrench[:, :3] - recording.wrench[:, :3].mean(axis=0)
    weight = force * (mass / MASS)
    less = np.hstack([weight, np.cross(cog, weight)])
    columns = dict(zip(CHANNELS, (recording.wrench - less).T, strict=True))
    return Recording(recording.metadata, {**recording.columns, **columns}, recording.name)


def refusal(recording):
    with pytest.raises(CalibrationError) as caught:
        calibrate(recording)
    return str(caught.value)


def is_the_load(recording):
    fit = calibrate(recording)
    assert fit["tool.mass"].value == pytest.approx(MASS, rel=0.01)
    assert [fit[f"tool.cog.{a}"].value for a in "xyz"] == pytest.approx(COG, abs=2e-3)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("torques", ["its own", "the other two"])
def test_a_mirrored_axis(sound, axis, torques):
    """Both remedies fit forces and torques alike; the stated centre tells which is meant."""
    signs = np.ones(6)
    signs[axis] = -1.0
    signs[3:] = signs[:3] if torques == "its own" else -signs[:3]
    words = refusal(scaled(sound, *signs))
    name = "xyz"[axis]
    its_own = f"turn over f{name} and t{name} in" in words
    assert its_own != (f"turn over f{name} and the torques about the other two" in words)
    followed = np.ones(6)
    followed[axis] = -1.0
    followed[3:] = followed[:3] if its_own else -followed[:3]
    is_the_load(scaled(scaled(sound, *signs), *followed))


def test_a_mirrored_axis_of_a_tool_that_nobody_states(sound):
    words = refusal(with_tool(scaled(sound, -1, 1, 1, -1, 1, 1), ToolInfo()))
    x, y, z = (round(1e3 * v) for v in COG)
    assert f"turn over fx and tx in the column map: the load is then at ({x}, {y}, {z}) mm" in words
    assert f"other two axes in the column map: the load is then at ({-x}, {-y}, {-z}) mm" in words


def test_counts(sound):
    words = refusal(scaled(sound, 1600.0, 32000.0))
    force, torque = (float(x) for x in re.findall(r"per = ([\d.e+]+)", words))
    is_the_load(scaled(scaled(sound, 1600.0, 32000.0), 1.0 / force, 1.0 / torque))


def test_pounds_and_inches(sound):
    words = refusal(scaled(sound, 1.0 / LBF, 1.0 / LBF_IN))
    assert "are they in lbf?" in words and "which then are in lbf·in" in words


@pytest.mark.parametrize("mass", [0.8 * MASS, 1.7 * MASS])
def test_a_payload_that_the_controller_subtracts(sound, mass):
    words = refusal(without_payload(sound, mass, np.array([0.0, 0.01, 0.05])))
    found = re.search(r"subtract a payload of ([\d.]+) kg at \((.*), (.*), (.*)\) mm", words)
    assert found is not None, words
    kilograms, *centre = (float(x) for x in found.groups())
    assert kilograms == pytest.approx(mass, rel=0.01)
    assert centre == pytest.approx([0.0, 10.0, 50.0], abs=2.0)


def test_torques_about_another_point_are_said_to_be(sound):
    tcp = np.array([0.0, 0.0, 0.15])
    force = sound.wrench[:, :3]
    torque = sound.wrench[:, 3:] - np.cross(tcp, force)
    columns = dict(zip(CHANNELS, np.hstack([force, torque]).T, strict=True))
    moved = Recording(sound.metadata, {**sound.columns, **columns}, sound.name)
    status = calibrate(moved).status
    x, y, z = (
        float(v) for v in re.findall(r"lies \((.*), (.*), (.*)\) mm from the stated", status)[0]
    )
    assert (x, y, z) == pytest.approx((0.0, 0.0, -150.0), abs=2.0) and "[wrench] about" in status
    assert "stated" not in calibrate(sound).status


def test_a_turn_about_one_joint_refutes_no_channel():
    """What the other channels leave open of the load is no evidence against one of them."""
    rng = np.random.default_rng(0)
    t = np.arange(8000) / 100.0
    q = np.tile([0.3, -1.2, 1.4, -0.9, 0.0, 0.4], (len(t), 1))
    q[:, 4] = 0.04 * t - 1.5
    force = MASS * GRAVITY @ np.array([flange(x)[:3, :3] for x in q])
    wrench = np.hstack([force, np.cross(COG, force)])
    wrench += np.repeat([0.05, 0.003], 3) * rng.standard_normal(wrench.shape)
    q += 2e-5 * rng.standard_normal(q.shape)
    columns = {"t": t} | {f"q{k + 1}": q[:, k] for k in range(6)}
    columns |= dict(zip(CHANNELS, wrench.T, strict=True))
    assert check(Recording(Metadata(robot="ur5", mode="dynamic"), columns, "turn.parquet")) is None
