"""Joint torques at rest against MuJoCo: arms of six and seven joints, effects, a load anywhere."""

import arm_torques as arm
import mujoco
import numpy as np
import pytest

from iiwa import IIWA
from plain_ur5 import turned
from wrenchbed import registry
from wrenchbed.channels.effort import CHANNEL
from wrenchbed.channels.held import held, ways
from wrenchbed.channels.response import readings
from wrenchbed.data.metadata import parse
from wrenchbed.data.recording import Recording
from wrenchbed.effects.chain import ActiveEffect
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.time_derivatives import Jet

UR5 = registry.load("robots", "ur5")
ARMS = pytest.mark.parametrize("robot", [UR5, IIWA], ids=["ur5", "iiwa14"])
GRAVITY = np.array([0.7, -0.4, -9.7])


def scene(robot, count=30):
    q, t = robot.sample(count, np.random.default_rng(0)), np.arange(float(count))
    held_rows = np.ones(count, dtype=bool)
    return Scene(robot, robot.parameters.nominal, GRAVITY, q, t, held_rows)


def channel_of(robot):
    names = [f"{n}{j + 1}" for n in ("q", "tau") for j in range(len(robot.joints))]
    columns = dict.fromkeys(("t", *names), np.arange(3.0))
    metadata = parse({"format": 1, "robot": robot.name, "source": "x", "mode": "static"}, "x")
    recording = Recording(metadata, columns, "x")
    assert CHANNEL.applies(recording)
    return CHANNEL.of(recording)


def at_rest(robot, q, gravity=GRAVITY, theta=None, edit=lambda model: None):
    """MuJoCo's torques (N, J)."""
    theta = robot.parameters.nominal if theta is None else theta
    return arm.inverse(robot, theta, Jet(q, 0.0 * q, 0.0 * q), gravity, edit)


def read(robot, *effects):
    active = [ActiveEffect.of(robot, name, values) for name, values in effects]
    return readings((channel_of(robot),), scene(robot), active)


@ARMS
def test_weight_of_the_arm_and_its_tool_is_mujocos(robot):
    assert np.abs(read(robot) - at_rest(robot, scene(robot).q)).max() < 1e-9


@ARMS
def test_effects_that_move_the_arm_or_its_tool_show_in_it(robot):
    q, nominal = scene(robot).q, robot.parameters.nominal
    offset = read(robot, ("joint.offset", {"joint": 3, "offset": 0.02}))
    assert np.abs(offset - at_rest(robot, q + 0.02 * np.eye(q.shape[1])[2])).max() < 1e-9
    tilt = read(robot, ("base.tilt", {"x": 0.02, "y": -0.03}))
    down = GRAVITY @ turned(np.array([-0.02, 0.03, 0.0]))
    assert np.abs(tilt - at_rest(robot, q, down)).max() < 1e-9
    tool = robot.tool(nominal)
    heavier = robot.theta_of_tool(nominal, float(tool.mass) + 0.4, list(tool.cog))
    loaded = at_rest(robot, q, theta=heavier)
    assert np.abs(read(robot, ("tool.mass", {"mass": 0.4})) - loaded).max() < 1e-9


def test_a_base_that_gives_tilts_links_and_tool_alike():
    rows = scene(UR5)
    give = read(UR5, ("base.compliance", {"compliance": 1e-4}))
    for k, moment in enumerate(rows.base_moment[:, :2]):
        down = GRAVITY @ turned(np.array([*(1e-4 * moment), 0.0]))
        assert np.abs(give[k] - at_rest(UR5, rows.q[k : k + 1], down)).max() < 1e-9


@ARMS
def test_a_wrench_on_the_sensor_is_held_as_in_mujoco(robot):
    rows, rng = scene(robot), np.random.default_rng(1)
    wrench = rng.normal(size=(len(rows), 6))
    model = robot.spec(robot.parameters.nominal).compile()
    data, torque = mujoco.MjData(model), np.zeros(rows.q.shape)
    tool = model.body("tool").id
    for k, q in enumerate(rows.q):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        turn, force = data.xmat[tool].reshape(3, 3), np.zeros(model.nv)
        mujoco.mj_applyFT(
            model, data, turn @ wrench[k, :3], turn @ wrench[k, 3:], data.xpos[tool], tool, force
        )
        torque[k] = -force
    assert np.abs(held(ways(robot, rows.q, rows.theta), wrench) - torque).max() < 1e-9


@ARMS
def test_ordinary_errors_of_links_are_those_of_mujocos_links(robot):
    """Columns after three a joint (gain, zero, friction): mass, then the centre along its axes."""
    q, joints = scene(robot).q, len(robot.joints)
    columns = channel_of(robot).imperfections(scene(robot))[:, :, 3 * joints :]
    for k, body in enumerate(robot.bodies[:joints]):

        def heavier(model, name=body.body):
            model.body_mass[model.body(name).id] *= 1.03

        change = at_rest(robot, q, edit=heavier) - at_rest(robot, q)
        assert np.abs(columns[:, :, 4 * k] - change).max() < 1e-9, body.body
        shifts = []
        for axis in np.eye(3):

            def shifted(model, axis=axis, name=body.body):
                model.body_sameframe[:] = 0  # else MuJoCo passes over some centres
                model.body_ipos[model.body(name).id] += 3e-3 * axis

            shifts.append(at_rest(robot, q, edit=shifted) - at_rest(robot, q))
        both = np.stack(shifts, axis=2)
        own = columns[:, :, 4 * k + 1 : 4 * k + 4]
        assert np.square(own).sum(axis=2) == pytest.approx(np.square(both).sum(axis=2), abs=1e-9)
