"""A contact that a few poses show: named where they have a point and a surface in common."""

from dataclasses import replace

import numpy as np
import pytest

import consistent
from simulated import WHITE, static
from wrenchbed import registry
from wrenchbed.data.metadata import ToolInfo
from wrenchbed.diagnosis.diagnose import diagnose
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.simulation.closed_form import Model

POSES, ROWS = 60, 30
LOAD = {"tool.mass": 1.374, "tool.cog.x": 0.0031, "tool.cog.y": -0.0042, "tool.cog.z": 0.0712}
FRICTION = 0.3
TIP_M = np.array([0.0, 0.0, 2.0 * LOAD["tool.cog.z"]])


@pytest.fixture(scope="module")
def free():
    rec = static("ur5", LOAD, poses=POSES, samples=ROWS, noise=WHITE, seed=8)
    tool = ToolInfo(LOAD["tool.mass"], tuple(LOAD[f"tool.cog.{k}"] for k in "xyz"))
    return replace(rec, metadata=replace(rec.metadata, tool=tool))


def poses_of(rec):
    model = Model.of(registry.load("robots", "ur5"))
    rotation, position = model.robot.sensor_pose(
        rec.q[::ROWS], model.parameters.vector(LOAD)[: len(model.robot.parameters)]
    )
    return rotation, position + rotation @ TIP_M


def with_forces(rec, world, point):
    """The recording with forces (POSES, 3) in world axes at a point of the tool."""
    force = np.einsum("nij,ni->nj", poses_of(rec)[0], world)
    wrench = np.repeat(np.concatenate([force, np.cross(point, force)], axis=1), ROWS, axis=0)
    more = {c: rec.columns[c] + wrench[:, k] for k, c in enumerate(CHANNELS)}
    return replace(rec, columns=dict(rec.columns) | more)


def lowest(rec, count):
    """A table under so many poses: its height [m], and how deep each tip is below it."""
    height = poses_of(rec)[1][:, 2]
    level = float(np.mean(np.sort(height)[count - 1 : count + 1]))
    return np.maximum(level - height, 0.0)


@pytest.mark.sampled
@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_table_that_a_few_poses_touch_is_a_contact(free, count):
    deep = lowest(free, count)
    push = 2.0 * np.sqrt(deep / deep.max())  # no law of the library
    world = push[:, None] * np.array([FRICTION, 0.0, 1.0])
    found = diagnose(with_forces(free, world, TIP_M + np.array([0.004, 0.0, -0.006])))
    told = found.diagnosis
    assert consistent.violations(found) == []
    assert told.verdict == "identified"
    (cause,) = told.which
    assert cause["effect"] == "environment.contact" and not cause["rivals"]
    assert cause["probability"] > 0.9 if count > 1 else 0.5 < cause["probability"] < 0.9
    for axis, true in zip("xyz", TIP_M + np.array([0.004, 0.0, -0.006]), strict=True):
        point = cause["parameters"][f"point.{axis}"]
        assert abs(point["value"] - true) < 4.0 * point["std"]
    assert {o["pose"] for o in told.outliers} == set(np.flatnonzero(deep).tolist())
    assert all(o["sentence"].endswith("contact") for o in told.outliers)


@pytest.mark.slow
@pytest.mark.parametrize(
    "how",
    [
        "at the flange",
        pytest.param("each its own way", marks=pytest.mark.study),
        pytest.param("not the lowest", marks=pytest.mark.study),
    ],
)
def test_pushes_without_point_way_or_surface_in_common_are_set_aside_only(free, how):
    chosen = np.flatnonzero(lowest(free, 2))
    if how == "not the lowest":
        chosen = np.argsort(poses_of(free)[1][:, 2])[POSES // 2 : POSES // 2 + 2]
    world = np.zeros((POSES, 3))
    world[chosen, 2] = 2.0
    if how == "each its own way":
        world[chosen[1]] = (0.0, 2.0, -1.0)
    point = -0.5 * TIP_M if how == "at the flange" else TIP_M
    told = diagnose(with_forces(free, world, point)).diagnosis
    assert (told.verdict, told.which) == ("none", [])
    assert {o["pose"] for o in told.outliers} == set(chosen.tolist())
    assert all(o["sentence"].endswith("contact, or wrong rows") for o in told.outliers)
