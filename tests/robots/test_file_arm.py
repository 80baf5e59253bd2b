"""Robots from MJCF and URDF: the closed form is the user's own file in MuJoCo."""

import mujoco
import numpy as np
import pytest
import test_robots
from test_robots import random_theta

import wrenchbed as wb
from arm_files import CASES, TOOL_COG, TOOL_MASS, PlainArm
from iiwa import IIWA
from wrenchbed import registry
from wrenchbed.effects.chain import active_effect, effects, respond
from wrenchbed.effects.scene import examples
from wrenchbed.robots.described import describe, read, rebuilt
from wrenchbed.twin.twin import nominal

each_file = pytest.mark.parametrize("case", CASES, ids=lambda c: c.file)


def arm_of(case, folder):
    stated = {"tool_mass": TOOL_MASS, "tool_cog": TOOL_COG}
    return describe(case.path, case.frame, folder / "my.toml", **stated).robot


def loads(robot, q, theta):
    """Closed form (N, 6) at robot parameters (P,)."""
    model = wb.Model.of(robot)
    full = model.parameters.nominal
    full[: len(theta)] = theta
    return model.true_wrench(q, full)


@each_file
def test_the_closed_form_is_the_users_file_in_mujoco(case, tmp_path):
    """Also with random parameters, as the robot's own MJCF has them."""
    robot = arm_of(case, tmp_path)
    rng = np.random.default_rng(5)
    plain = PlainArm(case.path, case.frame, robot.tool(robot.parameters.nominal))
    plain.model.opt.gravity[:] = robot.gravity
    q = robot.sample(60, rng)
    measured = plain.wrench(q, list(robot.joint_names))
    assert np.abs(measured).max() > 5.0
    assert np.abs(measured - loads(robot, q, robot.parameters.nominal)).max() < 1e-10
    for theta in (robot.parameters.nominal, random_theta(robot, rng), random_theta(robot, rng)):
        written = wb.Simulation(robot, theta).wrench(q)
        assert np.abs(written - loads(robot, q, theta)).max() < 1e-10


@each_file
def test_a_recording_carries_the_robot_with_joints_in_the_order_of_the_chain(
    case, tmp_path, request
):
    """Neither TOML nor model file are needed: the same numbers, to the last bit."""
    robot = arm_of(case, tmp_path)
    assert [j.name for j in robot.joints] == [f"q{k}" for k in range(1, case.joints + 1)]
    digits = [int(n[-1]) for n in robot.joint_names if n[-1].isdigit()]
    assert digits == sorted(digits)
    again = rebuilt(read(tmp_path / "my.toml").record)
    q = np.concatenate([robot.home[None], robot.sample(20, np.random.default_rng(0))])
    theta = robot.parameters.nominal
    assert robot.infeasible(q, theta) == {}
    assert again.name == robot.name
    assert again.spec(theta).to_xml() == robot.spec(theta).to_xml()
    assert np.array_equal(loads(again, q, theta), loads(robot, q, theta))
    request.addfinalizer(registry.forget())
    registry.remember("robots", robot.name, robot.record)
    assert registry.load("robots", robot.name).parameters.names == robot.parameters.names


CONTRACT = (
    test_robots.test_the_wrench_at_rest_is_the_same_in_mujoco_and_in_closed_form,
    test_robots.test_the_wrench_in_motion_is_newton_eulers,
    test_robots.test_gravity_is_seen_as_the_sensor_is_turned,
    test_robots.test_the_sensor_stands_where_mujoco_puts_it,
    test_robots.test_every_parameter_moves_something_or_is_listed_as_unobservable,
    test_robots.test_parameters_of_the_load_leave_the_sensor_where_it_is,
    test_robots.test_the_jacobian_is_that_of_complex_steps,
    test_robots.test_samples_are_feasible_seeded_and_turn_the_tool_about,
    test_robots.test_joints_outside_limits_are_refused_by_row,
    test_robots.test_an_inertia_of_no_body_is_refused,
)
"""What every robot keeps, but what is said of a file in ``models``."""


@pytest.mark.parametrize("contract", CONTRACT, ids=lambda c: c.__name__)
@pytest.mark.parametrize(
    "case", [CASES[0], pytest.param(CASES[5], marks=pytest.mark.slow)], ids=lambda c: c.file
)
def test_the_contract_of_every_robot(case, contract, tmp_path):
    contract(arm_of(case, tmp_path))


@pytest.mark.sampled
@pytest.mark.parametrize("case", [CASES[5], CASES[0], None], ids=["urdf", "mjcf", "iiwa14"])
def test_every_effect_of_an_arm_is_simulated_as_fitted(case, tmp_path):
    robot = IIWA if case is None else arm_of(case, tmp_path)
    (still, _), applied = examples(robot), 0
    for name, effect in effects().items():
        if not effect.between_rows and effect.acts(still) and effect.variants(still):
            active = [active_effect(robot, name)]
            closed = respond(still, active)
            change = np.abs(closed - respond(still)).max()
            apart = np.abs(nominal(robot, active).wrench(still) - closed).max()
            assert apart < 0.05 * change + 1e-9
            applied += 1
    assert applied > 20


def test_the_file_of_an_arm_is_written_from_its_data():
    ours = IIWA.drawn().compile()
    other = mujoco.MjModel.from_xml_path(str(IIWA.mjcf))
    for name in ("body_pos", "body_mass", "body_ipos", "qpos0", "jnt_range", "key_qpos"):
        mine, its = (getattr(model, name) for model in (ours, other))
        behind = 2 if name.startswith("body_") else 0  # the base's own inertial means nothing
        assert np.allclose(mine[behind:], its[behind:], rtol=0.0, atol=1e-8), name
    turn = np.abs((ours.body_quat * other.body_quat).sum(axis=1))
    assert np.abs(turn - 1.0).max() < 1e-12
