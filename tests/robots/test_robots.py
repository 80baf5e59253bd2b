"""Every simulated robot: MuJoCo and the closed form are the same, also in its arm's weight; names
and bounds of parameters, errors that help."""

import mujoco
import numpy as np
import pytest

import wrenchbed as wb
from iiwa import IIWA
from wrenchbed import errors, registry
from wrenchbed.errors import MissingExtraError, NotFoundError, ParameterError, PlanError
from wrenchbed.physics.taylor_jets import Jet
from wrenchbed.physics.wrench import wrench
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.robots.serial_arm import SerialArm
from wrenchbed.simulation.mujoco_wrench import Simulation, loop_sites

ROBOTS = [
    wb.load("robots", name)
    for name in wb.names("robots")
    if isinstance(wb.load("robots", name), SimulatedRobot)
] + [IIWA]
UR5 = wb.load("robots", "ur5").parameters
each_robot = pytest.mark.parametrize("robot", ROBOTS, ids=lambda r: r.name)


def random_theta(robot: SimulatedRobot, rng: np.random.Generator) -> np.ndarray:
    """Every parameter off by up to its tolerance; the inertia stays that of a body."""
    share = rng.uniform(-1, 1, len(robot.parameters))
    for i, p in enumerate(robot.parameters):
        if p.name.startswith("tool.inertia"):
            share[i] *= 0.05
        if p.name == "sensor.mass":
            share[i] = abs(share[i])
    return robot.parameters.nominal + share * robot.parameters.tolerance


def vectors(robot: SimulatedRobot) -> list[np.ndarray]:
    rng = np.random.default_rng(7)
    return [robot.parameters.nominal, *(random_theta(robot, rng) for _ in range(5))]


def feasible(robot: SimulatedRobot, n: int, theta: np.ndarray, seed: int) -> np.ndarray:
    q = robot.sample(n, np.random.default_rng(seed))
    good = np.ones(n, dtype=bool)
    good[list(robot.infeasible(q, theta))] = False
    assert good.mean() > 0.95
    return q[good]


@each_robot
def test_the_wrench_at_rest_is_the_same_in_mujoco_and_in_closed_form(robot):
    for theta in vectors(robot):
        q = feasible(robot, 200, theta, seed=1)
        simulated = Simulation(robot, theta).wrench(q)
        closed = wrench(*robot.sensor_pose(q, theta), robot.tool(theta), np.array(robot.gravity))
        assert np.abs(simulated).max() > 3.0
        assert np.abs(simulated - closed).max() < 1e-12


@each_robot
def test_the_wrench_in_motion_is_newton_eulers(robot):
    rng = np.random.default_rng(3)
    for theta in vectors(robot)[:4]:
        q = feasible(robot, 60, theta, seed=2)
        motion = Jet(q, rng.normal(size=q.shape), 5.0 * rng.normal(size=q.shape))
        simulated = Simulation(robot, theta).wrench(motion)
        pose = robot.sensor_pose(motion, theta)
        closed = wrench(*pose, robot.tool(theta), np.array(robot.gravity))
        at_rest = wrench(pose[0].v, pose[1].v, robot.tool(theta), np.array(robot.gravity))
        assert np.abs(closed - at_rest).max() > 1.0
        assert np.abs(simulated - closed).max() < 1e-9


@each_robot
def test_gravity_is_seen_as_the_sensor_is_turned(robot):
    """Of one robot, of many at once, and along complex steps."""
    rng = np.random.default_rng(7)
    names = robot.parameters
    q, gravity = robot.sample(9, rng), np.array([0.3, -0.4, -9.8])
    off = names.tolerance * rng.uniform(-1.0, 1.0, (4, 1, len(names)))
    for theta in (names.nominal, names.nominal + off, names.nominal + 1e-20j * off):
        rotation = robot.sensor_pose(q, theta)[0]
        seen = robot.gravity_seen(q, theta, gravity)
        expected = np.swapaxes(rotation, -1, -2) @ gravity
        assert seen.shape == expected.shape
        assert np.abs((seen - expected).real).max() < 1e-13
        assert np.abs((seen - expected).imag).max() < 1e-33
        assert np.iscomplexobj(seen) == np.iscomplexobj(theta)


@each_robot
def test_the_sensor_stands_where_mujoco_puts_it(robot):
    for theta in vectors(robot)[:5]:
        q = feasible(robot, 50, theta, seed=4)
        rotation, position = robot.sensor_pose(q, theta)
        simulation = Simulation(robot, theta)
        for i, row in enumerate(robot.qpos(q, theta)):
            simulation.data.qpos[:] = row
            mujoco.mj_kinematics(simulation.model, simulation.data)
            site = simulation.data.site("ft")
            assert np.abs(site.xpos - position[i]).max() < 1e-12
            assert np.abs(site.xmat.reshape(3, 3) - rotation[i]).max() < 1e-12
            for a, b in loop_sites(simulation.model):
                assert np.abs(np.subtract(*simulation.data.site_xpos[[a, b]])).max() < 1e-12


@each_robot
def test_every_parameter_moves_something_or_is_listed_as_unobservable(robot):
    rng = np.random.default_rng(5)
    theta = random_theta(robot, rng)
    q = feasible(robot, 20, theta, seed=6)
    motion = Jet(q, rng.normal(size=q.shape), rng.normal(size=q.shape))

    def seen(theta):
        load = wrench(*robot.sensor_pose(motion, theta), robot.tool(theta), np.array(robot.gravity))
        return np.hstack([robot.sensor_pose(q, theta)[1], load])

    still, before = [], seen(theta)
    for i, parameter in enumerate(robot.parameters):
        other = theta.copy()
        other[i] += 0.01 * parameter.tolerance
        if np.abs(seen(other) - before).max() < 1e-12:
            still.append(parameter.name)
    assert still == list(robot.unobservable)


@each_robot
def test_parameters_of_the_load_leave_the_sensor_where_it_is(robot):
    theta = robot.parameters.nominal
    q = feasible(robot, 5, theta, seed=9)
    before = robot.sensor_pose(q, theta)
    for i, parameter in enumerate(robot.parameters):
        other = theta.copy()
        other[i] += parameter.tolerance
        after = robot.sensor_pose(q, other)
        same = all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))
        lasting = same and parameter.name not in robot.unobservable
        assert lasting == (parameter.name in robot.load), parameter.name


@each_robot
def test_the_jacobian_is_that_of_complex_steps(robot):
    model, rng = wb.Model.of(robot), np.random.default_rng(4)
    theta = model.parameters.nominal
    theta[: len(robot.parameters)] = random_theta(robot, rng)
    q = feasible(robot, 7, robot.robot_theta(theta), seed=8)
    exact = model.jacobian(q, theta, range(len(theta)))
    for i, step in enumerate(1e-30j * np.eye(len(theta))):
        slope = model.read(model.plain_wrench(q, theta + step), theta + step).imag / 1e-30
        assert np.abs(exact[:, :, i] - slope).max() < 1e-12 * max(1.0, np.abs(slope).max())


@each_robot
def test_the_file_states_the_nominal_robot(robot):
    """What the MJCF says by itself and what the parameters write are one robot, to its digits."""
    plain = mujoco.MjModel.from_xml_path(str(robot.mjcf))
    written = robot.spec(robot.parameters.nominal).compile()
    for a, b in ((plain.body_pos, written.body_pos), (plain.site_pos, written.site_pos)):
        assert np.abs(a - b).max() < 1e-6
    turn = np.abs((plain.body_quat * written.body_quat).sum(axis=1))
    assert np.abs(turn - 1).max() < 1e-12
    assert np.abs(plain.body_mass - written.body_mass).max() < 1e-12
    assert np.abs(plain.opt.gravity - written.opt.gravity).max() == 0
    if robot is not IIWA:  # a page beside the file states where its numbers come from
        assert robot.mjcf.with_name("README.md").read_text(encoding="utf-8").strip()


@each_robot
def test_samples_are_feasible_seeded_and_turn_the_tool_about(robot):
    q = robot.sample(200, np.random.default_rng(0))
    assert np.array_equal(q, robot.sample(200, np.random.default_rng(0)))
    assert robot.infeasible(q, robot.parameters.nominal) == {}
    down = robot.sensor_pose(q, robot.parameters.nominal)[0][:, 2, :]
    assert np.linalg.svd(down - down.mean(axis=0), compute_uv=False)[-1] > 1.0


@each_robot
def test_joints_outside_limits_are_refused_by_row(robot):
    q = robot.sample(3, np.random.default_rng(0))
    q[1, 1] = np.rad2deg(q[1, 1])
    with pytest.raises(PlanError, match=r"plan: row 1: q2 = .* outside its limits.*degrees"):
        robot.check(q, robot.parameters.nominal, "plan")
    with pytest.raises(PlanError, match=f"has {len(robot.joints)} joints"):
        robot.check(q[:, :-1], robot.parameters.nominal, "plan")


@each_robot
def test_an_inertia_of_no_body_is_refused(robot):
    theta = robot.parameters.vector({"tool.inertia.xx": 1.0})
    with pytest.raises(ParameterError, match="inertia"):
        robot.spec(theta)


POSES = 12


class Heavy:
    def __init__(self, robot, theta, seed):
        self.robot, self.theta, self.gravity = robot, theta, np.array(robot.gravity)
        self.q = feasible(robot, POSES, theta, seed)
        spec = robot.spec(theta)
        spec.option.gravity = robot.gravity
        self.model = spec.compile()
        self.model.body_gravcomp[:] = 0.0
        self.data = mujoco.MjData(self.model)
        base = self.model.body("base").id
        self.moving = [b for b in range(self.model.nbody) if b not in (0, base)]

    def at(self, q, read):
        """What ``read`` finds in MuJoCo's data at each pose (N, J)."""
        rows = []
        for row in self.robot.qpos(q, self.theta):
            self.data.qpos[:] = row
            mujoco.mj_forward(self.model, self.data)
            rows.append(read(self.data).copy())
        return np.array(rows)

    def centres(self, q):
        """(N, bodies, 3) [m]."""
        return self.at(q, lambda data: data.xipos)

    def potential(self, q):
        """(N,) [J]."""
        mass = self.model.body_mass[self.moving]
        return -(self.centres(q)[:, self.moving] @ self.gravity) @ mass


def cases(robot):
    rng = np.random.default_rng(11)
    return [Heavy(robot, random_theta(robot, rng), seed) for seed in range(2)]


@each_robot
def test_joints_bear_what_mujoco_says(robot):
    """The slope of its potential energy; on serial arms also what holds them, joint by joint."""
    step = 1e-5
    for heavy in cases(robot):
        q = heavy.q
        torque = robot.gravity_torque(q, heavy.theta, heavy.gravity)
        for j, aside in enumerate(step * np.eye(q.shape[1])):
            slope = (heavy.potential(q + aside) - heavy.potential(q - aside)) / (2 * step)
            assert np.abs(torque[:, j] + slope).max() < 1e-5
        if isinstance(robot, SerialArm):
            assert np.abs(torque + heavy.at(q, lambda data: data.qfrc_bias)).max() < 1e-10
            assert np.abs(torque).max() > 20.0


@each_robot
def test_the_moment_at_the_base_is_the_sum_over_mujocos_bodies(robot):
    tilted = np.array([1.5, -2.0, -9.4])
    for heavy in cases(robot):
        levers = heavy.centres(heavy.q)[:, heavy.moving] - heavy.data.body("base").xpos
        weights = heavy.model.body_mass[heavy.moving, None] * tilted
        expected = np.cross(levers, weights).sum(axis=1)
        assert np.abs(expected).max() > 10.0
        assert np.abs(robot.base_moment(heavy.q, heavy.theta, tilted) - expected).max() < 1e-9


def test_a_robot_without_links_says_so():
    robot = wb.load("robots", "oriented")
    q, theta = robot.sample(2, np.random.default_rng(0)), robot.parameters.nominal
    gravity = np.array(robot.gravity)
    for ask, more in ((robot.links, ()), (robot.gravity_torque, (gravity,)),
                      (robot.base_moment, (gravity,))):  # fmt: skip
        with pytest.raises(NotFoundError, match="'oriented' has no masses of links"):
            ask(q, theta, *more)


def test_vectors_and_mappings_are_inverse_and_groups_select():
    theta = UR5.vector({"tool.mass": 2.0, "dq3": 0.01})
    assert UR5.mapping(theta)["tool.mass"] == 2.0
    assert np.array_equal(UR5.vector(UR5.mapping(theta)), theta)
    assert UR5.nominal[UR5.index("tool.mass")] == 1.35  # the set itself did not change
    names = lambda *patterns: [UR5.names[i] for i in UR5.select(patterns)]  # noqa: E731
    assert names("tool.cog") == ["tool.cog.x", "tool.cog.y", "tool.cog.z"]
    assert names("dq?", "a1") == ["a1", "dq1", "dq2", "dq3", "dq4", "dq5", "dq6"]
    assert names("tool.mass", "tool.mass") == ["tool.mass"]


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"tool.mas": 1.0}, "did you mean 'tool.mass'"),
        ({"tool.mass": -1.0}, "tool.mass = -1 kg lies outside"),
        ({"tool.mass": float("nan")}, "not a finite number"),
        ({"tool.mass": "1"}, "not a finite number"),
        ({"tool.mass": True}, "not a finite number"),
        ({"dq1": 90.0}, "is it in degrees?"),
        ({"a2": -425.0}, "is it in mm?"),
    ],
)
def test_a_wrong_value_is_named_with_its_remedy(values, words):
    with pytest.raises(ParameterError, match=words.replace("?", r"\?")):
        UR5.vector(values)


def test_unknown_plug_ins_and_extras_are_named(tmp_path, monkeypatch):
    with pytest.raises(NotFoundError, match=r"did you mean 'ur5'.*Known: medrue, oriented, ur5"):
        registry.load("robots", "ur55")
    with pytest.raises(NotFoundError, match=r"there is no robot 'none'\. Known: medrue"):
        registry.load("robots", "none")
    with pytest.raises(NotFoundError, match="no kind 'robot'"):
        registry.names("robot")
    with pytest.raises(MissingExtraError, match=r"pip install -e '\.\[hil\]'  in the clone"):
        registry.require("a_library_that_is_not_here", "hil")
    monkeypatch.setattr(registry, "__file__", str(tmp_path / "wrenchbed" / "registry.py"))
    with pytest.raises(MissingExtraError, match=r"run  pip install 'wrenchbed\[hil\]'$"):
        registry.require("a_library_that_is_not_here", "hil")
    assert registry.require("json", "hil").loads("1") == 1
    every = (e for e in vars(errors).values() if isinstance(e, type))
    own = [e for e in every if e.__module__ == errors.__name__]
    own.remove(errors.WrenchbedWarning)
    assert all(issubclass(e, errors.WrenchbedError) for e in own)
