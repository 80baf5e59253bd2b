"""Joint torques in closed form against MuJoCo, and the motions that tell most of them."""

import numpy as np
import pytest
from arm_torques import inverse
from test_robots import random_theta

from arm_files import CASES, TOOL_COG, TOOL_MASS
from simulated import driven
from wrenchbed import Plan, excite, multisine, registry
from wrenchbed.channels.holding_torques import LINK_MASS, of_links
from wrenchbed.cli import main
from wrenchbed.drives.identify import calibrate_efforts
from wrenchbed.effects.scene import Scene
from wrenchbed.errors import NotFoundError, PlanError
from wrenchbed.physics.taylor_jets import Jet
from wrenchbed.planning.collisions import Clearance
from wrenchbed.robots.base import SimulatedRobot, models
from wrenchbed.robots.chain import SerialChain
from wrenchbed.robots.checked_moves import Limits
from wrenchbed.robots.described import describe
from wrenchbed.robots.inverse_dynamics import rotor_torque, torque_regressor
from wrenchbed.robots.mjspec_edits import link_inertias
from wrenchbed.robots.ur5 import ur_arm
from wrenchbed.simulation.drives.drive_train import JointTorques


def moving(robot, rng):
    """Joint values, speeds and accelerations (40, J)."""
    at = robot.sample(40, rng)
    return Jet(at, rng.normal(size=at.shape), rng.normal(0.0, 5.0, at.shape))


def agree(robot, rng):
    """Closed form and MuJoCo, at nominal and at random parameters of tool and mount."""
    gravity = np.array([0.7, -0.4, -9.7])
    for theta in (robot.parameters.nominal, random_theta(robot, rng)):
        q, inertias = moving(robot, rng), link_inertias(robot, theta)
        ours = torque_regressor(robot, theta, q, gravity) @ inertias.phi.ravel()
        ours = ours + inertias.rotor * q.dd
        theirs = inverse(robot, theta, q, gravity)
        assert np.abs(theirs).max() > 20.0
        assert np.abs(ours - theirs).max() < 1e-9


@pytest.mark.parametrize("name", ["ur5", "ur10e", "ur20"])
def test_torques_are_those_of_mujoco(name):
    robot = registry.load("robots", "ur5") if name == "ur5" else ur_arm(name)
    agree(robot, np.random.default_rng(1))


@pytest.mark.parametrize("case", CASES, ids=lambda c: c.file)
def test_torques_of_an_arm_from_its_file_are_those_of_mujoco(case, tmp_path):
    stated = {"tool_mass": TOOL_MASS, "tool_cog": TOOL_COG}
    agree(describe(case.path, case.frame, tmp_path / "my.toml", **stated).robot,
          np.random.default_rng(2))  # fmt: skip


def closed_form(robot, theta, q):
    """Torques (N, J) by virtual work."""
    inertias = link_inertias(robot, theta)
    y = torque_regressor(robot, theta, q, np.asarray(robot.gravity))
    return y @ inertias.phi.ravel() + rotor_torque(robot, theta, inertias, q)


@pytest.mark.sampled
@pytest.mark.parametrize("way", [0.0, 1.0], ids=["rest", "motion"])
@pytest.mark.parametrize("name", ["medrue", "ur5", "five_bar", "stewart"])
def test_torques_of_closed_loops_are_those_of_mujocos_constraint_forces(name, way, tmp_path):
    """MedRUE at random parameters too; out of its plane, a five-bar's are of its joints' play."""
    rng, described = np.random.default_rng(3), name in ("five_bar", "stewart")
    robot = registry.load("robots", "medrue" if described else name)
    if described:
        robot = describe(models() / name / f"{name}.xml", "sensor", tmp_path / "my.toml").robot
    nominal = robot.parameters.nominal
    for theta in (nominal,) if described else (nominal, *(random_theta(robot, rng),) * 2):
        q = moving(robot, rng)
        q = q[np.setdiff1d(np.arange(40), list(robot.infeasible(q.v, theta)))]
        q = Jet(q.v, way * q.d, way * q.dd)
        theirs = JointTorques(robot, theta, robot.gravity).of(q)
        assert len(theirs) > 30 and np.abs(theirs).max() > 3.0
        assert np.abs(closed_form(robot, theta, q) - theirs).max() < 1e-9


def test_robots_without_links_have_no_torques_and_no_dynamics_to_excite(
    monkeypatch, tmp_path, capsys
):
    robot = registry.load("robots", "ur5")
    monkeypatch.setattr(SerialChain, "link_frames", SimulatedRobot.link_frames)
    with pytest.raises(NotFoundError, match="no frames of links"):
        link_inertias(robot, robot.parameters.nominal)
    with pytest.raises(PlanError, match="slides or loops"):
        excite(registry.load("robots", "medrue"), 30.0, 125.0, 0)
    with pytest.raises(PlanError, match="at least 5 s"):
        excite(UR5, 3.0, 125.0, 0)
    out = str(tmp_path / "p.parquet")
    assert main(["plan", "ur5", "--motion", "excite", "--out", out]) == 1
    assert "--for dynamics" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["ur5", "medrue"])
def test_errors_of_links_at_rest_are_shares_of_what_holds_them(name):
    """By differences of the links' heights; MedRUE has a link that no joint moves."""
    robot, step = registry.load("robots", name), 1e-6
    q, theta = robot.sample(10, np.random.default_rng(4)), robot.parameters.nominal
    gravity = np.asarray(robot.gravity)
    scene = Scene(robot, theta, gravity, q, np.arange(10.0), np.ones(10, dtype=bool))
    columns = of_links(scene)[..., ::4]
    mass = robot.links(q, theta)[0][: columns.shape[2]]
    for j, one in enumerate(np.eye(q.shape[1])):
        up, down = (robot.links(q + s * step * one, theta)[1] @ gravity for s in (1.0, -1.0))
        slope = (up - down)[: len(mass)].T / (2.0 * step)
        assert columns[:, j] == pytest.approx(-LINK_MASS * mass * slope, abs=1e-6)


UR5 = registry.load("robots", "ur5")
SECONDS, RATE = 30.0, 125.0


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    out = tmp_path_factory.mktemp("plan") / "p.parquet"
    words = f"plan ur5 --motion excite --for dynamics --seconds {SECONDS:g} --seed 1 --out {out}"
    assert main(words.split()) == 0
    return Plan.read(out)


@pytest.mark.slow
def test_it_is_within_limits_and_touches_nothing(plan):
    assert len(plan) == SECONDS * RATE
    q, clearance = plan.q, Clearance(UR5)
    assert not UR5.infeasible(q, UR5.parameters.nominal)
    speed, acceleration = np.gradient(q, 1 / RATE, axis=0), np.diff(q, 2, axis=0) * RATE**2
    assert (np.abs(speed).max(axis=0) <= 0.61 * np.array([j.speed for j in UR5.joints])).all()
    assert np.abs(acceleration).max() < 4.1
    assert np.abs(speed[[0, -1]]).max() < 0.02
    assert not any(clearance.hit(place) for place in q[::10])


@pytest.mark.slow
def test_its_standard_errors_are_smaller_than_a_multisines(plan, tmp_path):
    stds = []
    for k, way in enumerate((plan, multisine(UR5, SECONDS, RATE, 1))):
        options = {"seed": 2, "effort": "torque", "limits": Limits(speed=0.5, tracking=1.0)}
        recording = driven(way, tmp_path / f"{k}.parquet", **options)
        fit = calibrate_efforts(recording, ("drive",))  # a tool's ± hold links' errors, not noise
        stds.append({p.name: p.std for p in fit.identified if p.std is not None})
    ratio = [stds[1][n] / stds[0][n] for n in stds[0] if n in stds[1]]
    assert np.median(ratio) > 1.5
