"""Models as a viewer opens them: nothing leaps, loops stay closed, tools touch the world."""

import mujoco
import numpy as np
import pytest

from wrenchbed import registry
from wrenchbed.robots.base import models
from wrenchbed.robots.described import describe
from wrenchbed.robots.ur5 import ur_arm
from wrenchbed.simulation.simulation import Simulation
from wrenchbed.twin.export import export
from wrenchbed.twin.twin import nominal

NAMES = ("ur5", "medrue", "five_bar", "stewart")
SECONDS, STILL, CLOSED = 1.0, 0.05, 1e-4
PUSH = 20.0


def file_of(name):
    return models() / name / f"{name}.xml"


def opened(model, key):
    """As ``python -m mujoco.viewer`` opens it, or from its first keyframe."""
    data = mujoco.MjData(model)
    if key and model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    else:
        mujoco.mj_resetData(model, data)
    return data


def run(model, data, seconds, force=None):
    """Highest speed of a joint, and widest gap of a loop [m]."""
    names = [model.body(b).name for b in range(model.nbody)]
    tool = next(names.index(n) for n in ("tool", "probe", "gripper") if n in names)
    fastest, gap = 0.0, 0.0
    closed = int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    for _ in range(round(seconds / model.opt.timestep)):
        if force is not None:
            data.xfrc_applied[tool, :3] = force
        mujoco.mj_step(model, data)
        fastest = max(fastest, float(np.abs(data.qvel).max()))
        of_loops = data.efc_pos[: data.nefc][data.efc_type[: data.nefc] == closed]
        gap = max(gap, float(np.abs(of_loops).max(initial=0.0)))
    return fastest, gap


@pytest.mark.parametrize("key", [False, True])
@pytest.mark.parametrize("name", NAMES)
def test_a_model_stays_as_it_opens_by_servos_with_limits(name, key):
    model = mujoco.MjModel.from_xml_path(str(file_of(name)))
    data = opened(model, key)
    before = data.qpos.copy()
    fastest, gap = run(model, data, SECONDS)
    assert fastest < STILL
    assert np.abs(data.qpos - before).max() < 1e-6
    assert gap < CLOSED
    assert model.actuator_forcelimited.all()
    assert (model.actuator_forcerange[:, 1] > 0.0).all()
    driven = model.jnt_dofadr[model.actuator_trnid[:, 0]]
    assert (model.dof_damping[driven] > 0.0).all()
    assert (model.dof_frictionloss[driven] > 0.0).all()


@pytest.mark.parametrize("force", [[PUSH, 0.0, PUSH], [0.0, PUSH, -PUSH]])
@pytest.mark.parametrize("name", NAMES)
def test_loops_stay_closed_and_servos_hold_while_the_tool_is_pushed(name, force):
    model = mujoco.MjModel.from_xml_path(str(file_of(name)))
    data = opened(model, False)
    before = data.qpos.copy()
    _, gap = run(model, data, SECONDS, force)
    assert gap < CLOSED
    assert np.abs(data.qvel).max() < STILL
    assert np.abs(data.qpos - before).max() < 0.02


@pytest.mark.parametrize(
    ("name", "point", "top"),
    [("ur5", (0.25, -0.109, -0.06), -0.016), ("medrue", (0.1505, 0.4393, -0.33), -0.286)],
    ids=["ur5", "medrue"],
)
def test_the_tool_does_not_pass_through_what_stands_there(name, point, top):
    """Driven down, the tip stops at bench or leg; without contact it arrives inside."""
    robot = registry.load("robots", name)
    inside = Simulation(robot, robot.parameters.nominal).seated(robot.home, np.array(point))
    heights = {}
    for touching in (True, False):
        model = mujoco.MjModel.from_xml_path(str(file_of(name)))
        if not touching:
            model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        data = opened(model, False)
        for k in range(1500):
            data.ctrl[:] = (inside - robot.home) * min(1.0, k / 1000)
            mujoco.mj_step(model, data)
        bodies = {model.body(model.geom_bodyid[g]).name for c in data.contact for g in c.geom}
        assert ({"tool", "world"} <= bodies) is touching
        heights[touching] = float(data.site("tcp").xpos[2])
    assert heights[False] == pytest.approx(point[2], abs=1e-3)
    assert heights[True] > top - 0.02  # soft contact against stiff servos


@pytest.mark.parametrize("name", ["ur5", "medrue"])
def test_what_is_computed_knows_none_of_it(name):
    robot = registry.load("robots", name)
    theta = robot.parameters.nominal
    model = robot.spec(theta).compile()
    assert model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT
    assert not model.dof_damping.any()
    assert not model.dof_frictionloss.any()
    assert not model.actuator_forcelimited.any()
    assert not model.geom_contype.any()


@pytest.mark.parametrize(
    "make",
    [
        lambda folder: registry.load("robots", "ur5"),
        lambda folder: registry.load("robots", "medrue"),
        lambda folder: ur_arm("ur10e"),
        lambda folder: describe(file_of("stewart"), "sensor", folder / "s.toml").robot,
        lambda folder: describe(file_of("five_bar"), "sensor", folder / "f.toml").robot,
    ],
    ids=["ur5", "medrue", "ur10e", "stewart", "five_bar"],
)
def test_an_exported_model_stays_as_it_opens(make, tmp_path):
    robot = make(tmp_path)
    mjcf, _ = export(nominal(robot), tmp_path / "out")
    model = mujoco.MjModel.from_xml_path(str(mjcf))
    data = opened(model, False)
    at = [int(model.joint(j.name).qposadr[0]) for j in robot.joints]
    assert np.abs(data.qpos[at] - robot.home).max() < 1e-5  # MuJoCo writes six digits
    fastest, gap = run(model, data, 0.5)
    assert fastest < STILL
    assert gap < CLOSED
