"""Channels against MuJoCo and plain numpy, and when an accelerometer cannot be compared."""

import arm_torques as arm
import mujoco
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from iiwa import IIWA
from plain_ur5 import GRAVITY, flange, poses, turned
from simulated import driven
from wrenchbed import registry
from wrenchbed.channels.holding_torques import held_wrench, twists
from wrenchbed.channels.own_noise import own_noise
from wrenchbed.channels.readings_with_effects import readings
from wrenchbed.data.metadata import parse
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.prepare.prepare_recording import prepare
from wrenchbed.effects.chain import ActiveEffect, EffectChain
from wrenchbed.effects.scene import Scene
from wrenchbed.hardware.drivers.sim import Beside, SimOptions
from wrenchbed.physics.taylor_jets import Jet, value
from wrenchbed.planning.choose import multisine
from wrenchbed.twin.twin import nominal

UR5 = registry.load("robots", "ur5")
NAMES = ("accelerometer", "effort", "pose")
ACCELEROMETER, EFFORT, POSE = (registry.load("channels", name) for name in NAMES)
ARMS = pytest.mark.parametrize("robot", [UR5, IIWA], ids=["ur5", "iiwa14"])
Q = poses(30, np.random.default_rng(0))
ASKEW = np.array([0.7, -0.4, -9.7])
"""Gravity in the base [m/s²]."""


def scene(robot, q, gravity=None):
    rows, t = np.ones(len(q), dtype=bool), np.arange(float(len(q)))
    gravity = np.array(robot.gravity) if gravity is None else gravity
    return Scene(robot, robot.parameters.nominal, gravity, q, t, rows)


def test_it_reads_gravity_in_its_own_axes():
    rotation = np.array([flange(q)[:3, :3] for q in Q])
    rng = np.random.default_rng(1)
    mounted, zero = np.linalg.qr(rng.standard_normal((3, 3)))[0], rng.standard_normal(3)
    gain = mounted @ (np.eye(3) + 0.1 * rng.standard_normal((3, 3)))
    fitted = ACCELEROMETER.fitted(GRAVITY @ rotation @ gain + zero, scene(UR5, Q))
    assert fitted.gain == pytest.approx(gain) and fitted.zero == pytest.approx(zero)
    tilt = ActiveEffect.of(UR5, "base.tilt", {"x": 0.02, "y": -0.03})
    seen = turned(np.array([0.02, -0.03, 0.0])) @ GRAVITY @ rotation
    assert readings((fitted,), scene(UR5, Q), [tilt]) == pytest.approx(seen @ gain + zero)


@pytest.mark.parametrize("scale", [0.0, 1.0 / 9.81, 1000.0], ids=["dead", "in g", "in mm/s²"])
def test_readings_in_another_unit_or_of_a_dead_sensor_are_not_compared(scale):
    read = scale * readings((ACCELEROMETER,), scene(UR5, Q))
    assert ACCELEROMETER.fitted(read + 0.02, scene(UR5, Q)) is None


def test_poses_that_turn_gravity_too_little_determine_no_mounting():
    same = np.repeat(Q[:1], 20, axis=0)
    about_gravity = same + np.eye(6)[0] * np.linspace(0.0, 3.0, 20)[:, None]
    for q in (same, about_gravity):
        read = readings((ACCELEROMETER,), scene(UR5, q))
        assert ACCELEROMETER.fitted(read + 1e-3, scene(UR5, q)) is None


def felt(robot, q, place, gravity=ASKEW):
    """What MuJoCo's accelerometer at a place (3,) of the tool, turned anyhow, reads (N, 3)."""
    spec = robot.spec(robot.parameters.nominal)
    spec.option.gravity = gravity
    tool = next(body for body in spec.bodies if body.name == "tool")
    tool.add_site(name="imu", pos=place, quat=[0.8, 0.2, -0.5, 0.3])
    kind, site = mujoco.mjtSensor.mjSENS_ACCELEROMETER, mujoco.mjtObj.mjOBJ_SITE
    spec.add_sensor(name="imu", type=kind, objtype=site, objname="imu")
    model = spec.compile()
    data, read = mujoco.MjData(model), np.empty((len(q.v), 3))
    for k in range(len(read)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q.v[k], q.d[k], q.dd[k]
        mujoco.mj_inverse(model, data)
        read[k] = data.sensor("imu").data
    return read


@ARMS
def test_in_motion_it_reads_what_mujocos_does_wherever_and_whenever_it_is(robot):
    t, q = arm.fourier(np.random.default_rng(0), 4.0, 100.0, robot.home)
    place, zero, moving = [0.03, -0.02, 0.04], np.array([0.2, -0.1, 0.3]), np.ones(len(t), bool)
    rows = Scene(robot, robot.parameters.nominal, ASKEW, q, t, moving)
    read = felt(robot, q, place) + zero
    fitted = ACCELEROMETER.fitted(read, rows)
    assert fitted.place == pytest.approx(place, abs=1e-9) and abs(fitted.lag) < 1e-9
    assert np.abs(readings((fitted,), rows) - read).max() < 1e-9
    shifted = Jet(q.v + 0.02 * np.eye(q.v.shape[1])[2], q.d, q.dd)
    offset = ActiveEffect.of(robot, "joint.offset", {"joint": 3, "offset": 0.02})
    moved = felt(robot, shifted, place) + zero
    assert np.abs(readings((fitted,), rows, [offset]) - moved).max() < 1e-9
    late = ACCELEROMETER.fitted(CubicSpline(t, read)(t - 0.003), rows)
    assert late.lag == pytest.approx(0.003, rel=0.02)


def test_the_simulated_one_reads_in_motion_what_mujocos_does_up_to_gain_and_zero():
    t, q = arm.fourier(np.random.default_rng(0), 6.0, 100.0, UR5.home)
    beside = Beside(nominal(UR5), SimOptions("ur5", noise="off", imu=0.02))
    read = np.stack([*beside.in_motion(t, q.v).values()], axis=1)
    rows = Scene(UR5, UR5.parameters.nominal, np.array(UR5.gravity), q, t, np.ones(len(t), bool))
    place = ACCELEROMETER.fitted(read, rows).place
    felt_there = np.column_stack([felt(UR5, q, place, UR5.gravity), np.ones(len(t))])
    left = read - felt_there @ np.linalg.lstsq(felt_there, read, rcond=None)[0]
    assert np.abs(left[10:-10]).max() < 1e-3 * read.std() and np.abs(place).max() > 0.005


def test_in_motion_it_is_compared_beside_the_wrench_to_its_noise(tmp_path):
    plan = multisine(UR5, 8.0, 100.0, 1)
    whole = driven(plan, tmp_path / "rec.parquet", seed=1, noise="white")
    path, rng = CubicSpline(whole.t, whole.q), np.random.default_rng(1)
    q = Jet(*(path(whole.t, k) for k in range(3)))
    read = felt(UR5, q, [0.03, 0.0, 0.05], UR5.gravity) + 0.02 * rng.normal(size=(len(whole), 3))
    columns = {**whole.columns, **dict(zip(ACCELEROMETER.columns, read.T, strict=True))}
    prepared = prepare(Recording(whole.metadata, columns))
    assert [channel.name for channel in prepared.channels] == ["wrench", "accelerometer"]
    assert prepared.sigma[6:] == pytest.approx([0.02] * 3, rel=0.3)


@pytest.mark.parametrize("seed", range(5))
def test_its_own_noise_is_what_no_effect_explains(seed):
    """White noise of 0.01, nuisance, and effects ten and no times as large."""
    rng = np.random.default_rng(seed)
    nuisance, columns = rng.standard_normal((150, 12)), rng.standard_normal((150, 40))
    noise = 0.01 * rng.standard_normal(150)
    away = nuisance @ rng.standard_normal(12)
    for size in (0.0, 0.1):
        one = columns[:, 0] * size
        assert own_noise(one + away + noise, nuisance, columns) == pytest.approx(0.01, rel=0.35)


def test_readings_that_nuisance_fits_exactly_have_no_noise_of_their_own():
    assert own_noise(np.ones(4), np.eye(4), np.zeros((4, 2))) == 0.0


def askew(robot):
    return scene(robot, robot.sample(30, np.random.default_rng(0)), ASKEW)


def channel_of(robot):
    names = [f"{n}{j + 1}" for n in ("q", "tau") for j in range(len(robot.joints))]
    columns = dict.fromkeys(("t", *names), np.arange(3.0))
    metadata = parse({"format": 1, "robot": robot.name, "source": "x", "mode": "static"}, "x")
    recording = Recording(metadata, columns, "x")
    assert EFFORT.applies(recording)
    return EFFORT.of(recording)


def at_rest(robot, q, gravity=ASKEW, theta=None, edit=lambda model: None):
    """MuJoCo's torques (N, J)."""
    theta = robot.parameters.nominal if theta is None else theta
    return arm.inverse(robot, theta, Jet(q, 0.0 * q, 0.0 * q), gravity, edit)


def read(robot, *effects):
    active = [ActiveEffect.of(robot, name, values) for name, values in effects]
    return readings((channel_of(robot),), askew(robot), active)


@ARMS
def test_effects_that_move_the_arm_or_its_tool_show_in_it(robot):
    q, nominal = askew(robot).q, robot.parameters.nominal
    offset = read(robot, ("joint.offset", {"joint": 3, "offset": 0.02}))
    assert np.abs(offset - at_rest(robot, q + 0.02 * np.eye(q.shape[1])[2])).max() < 1e-9
    tilt = read(robot, ("base.tilt", {"x": 0.02, "y": -0.03}))
    down = ASKEW @ turned(np.array([-0.02, 0.03, 0.0]))
    assert np.abs(tilt - at_rest(robot, q, down)).max() < 1e-9
    tool = robot.tool(nominal)
    heavier = robot.theta_of_tool(nominal, float(tool.mass) + 0.4, list(tool.cog))
    loaded = at_rest(robot, q, theta=heavier)
    assert np.abs(read(robot, ("tool.mass", {"mass": 0.4})) - loaded).max() < 1e-9


def test_a_base_that_gives_tilts_links_and_tool_alike():
    rows = askew(UR5)
    give = read(UR5, ("base.compliance", {"compliance": 1e-4}))
    for k, moment in enumerate(rows.base_moment[:, :2]):
        down = ASKEW @ turned(np.array([*(1e-4 * moment), 0.0]))
        assert np.abs(give[k] - at_rest(UR5, rows.q[k : k + 1], down)).max() < 1e-9


@ARMS
def test_a_wrench_on_the_sensor_is_held_as_in_mujoco(robot):
    rows, rng = askew(robot), np.random.default_rng(1)
    wrench = rng.normal(size=(len(rows), 6))
    model = robot.spec(robot.parameters.nominal).compile()
    data, torque = mujoco.MjData(model), np.zeros(rows.q.shape)
    tool = model.body("tool").id
    for k, q in enumerate(rows.q):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        turn, force = data.xmat[tool].reshape(3, 3), np.zeros(model.nv)
        pull, twist = turn @ wrench[k, :3], turn @ wrench[k, 3:]
        mujoco.mj_applyFT(model, data, pull, twist, data.xpos[tool], tool, force)
        torque[k] = -force
    assert np.abs(held_wrench(twists(robot, rows.q, rows.theta), wrench) - torque).max() < 1e-9


@ARMS
def test_ordinary_errors_of_links_are_those_of_mujocos_links(robot):
    """Columns after three a joint (gain, zero, friction): mass, then the centre along its axes."""
    q, joints = askew(robot).q, len(robot.joints)
    columns = channel_of(robot).imperfections(askew(robot))[:, :, 3 * joints :]
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


@pytest.mark.parametrize("name", ["ur5", "medrue"])
@pytest.mark.parametrize("effect", ["", "joint.offset", "link.length"])
def test_the_sensor_is_where_mujoco_has_it(name, effect):
    robot = registry.load("robots", name)
    rows = scene(robot, robot.sample(20, np.random.default_rng(0)))
    active = []
    if effect:
        own = registry.load("effects", effect)
        sizes = {p.name: p.tolerance for p in own.parameters(robot)}
        active = [ActiveEffect.of(robot, effect, sizes)]
    pose, _ = EffectChain(active).placed(rows)
    turn, place = nominal(robot, active).place(rows)
    assert value(pose.position) == pytest.approx(place, abs=1e-12)
    assert value(pose.rotation) == pytest.approx(turn, abs=1e-12)


@pytest.mark.parametrize(("channel", "std"), [(POSE, 5e-5), (ACCELEROMETER, 0.02)])
def test_what_is_simulated_beside_the_wrench_is_seen_by_its_channel_to_its_noise(channel, std):
    robot, q, option = registry.load("robots", "ur5"), Q, "tracker" if channel is POSE else "imu"
    for noise in ("off", "real"):
        options = SimOptions("ur5", noise=noise, seed=3, **{option: std})
        beside = Beside(nominal(robot), options)
        read = np.array([[beside.columns(x, 1)[c][0] for c in channel.columns] for x in q])
        fitted = channel.fitted(read, scene(robot, q))
        left = (read - readings((fitted,), scene(robot, q))).std()
        assert left < 1e-9 if noise == "off" else 0.5 * std < left < 1.5 * std
    name = next(iter(channel.columns))
    first, again = (beside.columns(q[0], 4)[name] for _ in range(2))
    assert np.ptp(first) > 0.0 and abs(first.mean() - again.mean()) < 6.0 * std
