"""Gymnasium environments: sound, seeded, vectorised; the baselines beat chance."""

import os
import subprocess
import sys
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import wrenchbed as wb
import wrenchbed.environments
from wrenchbed.environments.calibration import knowledge
from wrenchbed.environments.contact import Hand
from wrenchbed.environments.policies import ForceController, GreedyInformation
from wrenchbed.errors import ParameterError
from wrenchbed.plant.contact_surface import Limb, tip_of

ROBOTS = ("UR5", "MedRUE")
NAMES = [f"wrenchbed/{r}{kind}-v0" for r in ROBOTS for kind in ("Calibration", "Contact")]
SOME = [NAMES[0], NAMES[3], *(pytest.param(n, marks=pytest.mark.slow) for n in NAMES[1:3])]
"""A robot of each kind, and what is left of both."""
SHORT = {"Calibration": {"budget": 15.0, "pool": 24}, "Contact": {"seconds": 0.6}}


def made(name, **more):
    kind = "Contact" if "Contact" in name else "Calibration"
    return gymnasium.make(name, **{**SHORT[kind], **more})


def played(env, seed, policy=None):
    """Observations, rewards and the last info of an episode."""
    seen, told = env.reset(seed=seed)
    env.action_space.seed(seed)
    rows, rewards = [seen], []
    act = policy(env) if policy else lambda _: env.action_space.sample()
    while True:
        seen, reward, ended, cut, told = env.step(act(seen))
        rows.append(seen)
        rewards.append(reward)
        if ended or cut:
            return np.array(rows), np.array(rewards), told


@pytest.mark.parametrize("name", SOME)
def test_gymnasium_finds_nothing_to_complain_of(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(made(name).unwrapped, skip_render_check=True)


@pytest.mark.sampled
@pytest.mark.parametrize("robot", ROBOTS)
def test_greedy_information_and_a_force_controller_beat_chance(robot):
    env = gymnasium.make(f"wrenchbed/{robot}Calibration-v0", budget=40.0, pool=64)
    for seed in range(2):
        chance, told = played(env, seed)[1:]
        greedy, better = played(env, seed, GreedyInformation)[1:]
        assert greedy.sum() > 1.1 * chance.sum() > 0
        assert better["error"] < told["error"]
    env = gymnasium.make(f"wrenchbed/{robot}Contact-v0", seconds=5.0)
    rewards, told = played(env, 0, ForceController)[1:]
    assert rewards.sum() > played(env, 0)[1].sum() + 100
    assert abs(told["force"] - told["wanted"]) < 0.3
    assert rewards[-50:].min() > -0.1


def test_effects_are_randomised_and_felt():
    bare, ill = (gymnasium.make(NAMES[1], seconds=0.6, effects=e) for e in ((), ("sensor.gain",)))
    without, with_ = (played(e, 3, ForceController)[0] for e in (bare, ill))
    assert ill.unwrapped.body.time > 0 and not np.array_equal(without, with_)


def test_rewards_of_a_calibration_add_up_to_what_is_known():
    env = made(NAMES[0], budget=30.0)
    rewards, told = played(env, 1)[1:]
    known = env.unwrapped.knowledge
    start = env.unwrapped._unread
    assert rewards.sum() == pytest.approx(known.value - start.value)
    assert known.value == pytest.approx(-np.log(told["error"]))
    assert 30.0 <= told["seconds"] < 60.0


def test_what_is_known_is_the_information_of_a_fit_and_gains_are_what_a_pose_adds():
    """(I + Σ JᵀJ)⁻¹ in tolerances, against all rows at once."""
    robot = wb.load("robots", "ur5")
    model = wb.Model.of(robot)
    pool = robot.sample(9, np.random.default_rng(1))
    std = np.array([0.03] * 3 + [0.001] * 3)
    state = knowledge(model, pool, std)
    for pose in range(9):
        more = state.with_pose(pose)
        assert state.gains()[pose] == pytest.approx(more.value - state.value, rel=1e-9)
        state = more
    columns = list(state.columns)
    rows = model.jacobian(pool, model.parameters.nominal, columns)
    rows = (rows * model.parameters.tolerance[columns] / std[:, None]).reshape(-1, len(columns))
    exact = np.linalg.inv(np.eye(len(columns)) + rows.T @ rows)
    assert np.allclose(np.linalg.inv(state.information), exact, atol=1e-10)


@pytest.mark.parametrize("name", ["ur5", "medrue"])
def test_a_hand_moves_straight_and_keeps_its_orientation(name):
    robot = wb.load("robots", name)
    hand = Hand(robot)
    start, kept = hand.tip, hand.orientation
    for _ in range(40):
        hand.move(np.array([0.0003, -0.0002, 0.0004]), 2)
    rotation, tip = tip_of(robot, hand.q[None], robot.parameters.nominal)
    assert np.abs(tip[0] - start - 40 * np.array([0.0003, -0.0002, 0.0004])).max() < 1e-4
    assert np.abs(rotation[0] - kept).max() < 1e-4
    assert np.abs(hand.tip - tip[0]).max() < 1e-4


def test_a_hand_stands_still_at_the_edge_of_its_workspace():
    hand = Hand(wb.load("robots", "medrue"))
    for _ in range(2000):
        last = hand.move(np.array([0.0, 0.0, -0.002]), 1)
    assert np.array_equal(last[0], hand.q)
    assert not hand.robot.infeasible(hand.q[None], hand.robot.parameters.nominal)


def test_a_limb_pushes_back_along_its_normal_and_drags():
    limb = Limb(np.zeros(3), np.array([1.0, 0.0, 0.0]), 0.05, 1000.0, damping=2.0, friction=0.3)
    assert np.array_equal(limb.push(np.array([0.2, 0.0, 0.06]), np.zeros(3)), np.zeros(3))
    assert np.allclose(limb.push(np.array([0.2, 0.0, 0.04]), np.zeros(3)), [0.0, 0.0, 10.0])
    closing = limb.push(np.array([0.0, 0.0, 0.04]), np.array([0.0, 0.0, -0.1]))
    assert np.allclose(closing, [0.0, 0.0, 12.0])  # 10 N · (1 + 2 s/m · 0.1 m/s)
    sliding = limb.push(np.array([0.0, 0.04, 0.0]), np.array([0.5, 0.0, 0.0]))
    assert np.allclose(sliding, [-3.0, 10.0, 0.0])
    parting = limb.push(np.array([0.0, 0.0, 0.04]), np.array([0.0, 0.0, 10.0]))
    assert np.abs(parting).max() == 0.0  # it does not pull


def test_nonsense_is_refused_by_name():
    with pytest.raises(ParameterError, match="budget must be above 0 s"):
        gymnasium.make(NAMES[0], budget=-1.0)
    with pytest.raises(ParameterError, match="calibration environments"):
        GreedyInformation(made(NAMES[1]))
    with pytest.raises(ParameterError, match="no model"):
        gymnasium.make(NAMES[1], robot="oriented")


def test_importing_wrenchbed_after_gymnasium_registers_them():
    code = f"import gymnasium, wrenchbed; gymnasium.make({NAMES[2]!r})"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.sampled
@pytest.mark.parametrize("name", NAMES)
def test_it_is_drawn(name):
    env = made(name, render_mode="rgb_array")
    env.reset(seed=1)
    try:
        picture = env.render()
    except Exception as error:
        if "WRENCHBED_PICTURES" in os.environ:
            raise
        pytest.skip(f"MuJoCo draws nothing here, libegl1 is not installed: {error}")
    assert picture.shape == (480, 640, 3) and picture.std() > 10
    env.close()
