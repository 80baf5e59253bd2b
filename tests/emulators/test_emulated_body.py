"""The robot behind the wires: its readings at rest and on the way, and the UR5's own wrench."""

import numpy as np
import pytest
from scipy.signal import savgol_filter
from scipy.spatial.transform import Rotation

from unstarted import emulated
from wrenchbed.hardware.drivers import sim
from wrenchbed.hardware.drivers.rtde import own_wrench
from wrenchbed.hardware.drivers.rtde.states import Snapshot
from wrenchbed.physics.taylor_jets import Jet
from wrenchbed.plant.contact_surface import Plate
from wrenchbed.plant.realtime_robot import Body, BodyOptions
from wrenchbed.plant.serving import EmulatorOptions
from wrenchbed.robots.ur5 import ur_arm
from wrenchbed.simulation.mujoco_wrench import Simulation

CYCLE = 0.008


def go(body: Body, q: np.ndarray, seconds: float = 1.0, rest: float = 0.5) -> list[np.ndarray]:
    """Move there smoothly and rest; the readings of each cycle on the way."""
    start, n = np.array(body.target), round(seconds / CYCLE)
    shown = []
    for k in range(n + round(rest / CYCLE)):
        s = min((k + 1) / n, 1.0)
        body.step(start + (10 * s**3 - 15 * s**4 + 6 * s**5) * (q - start))
        shown.append(body.readings(np.array([body.newest[1]]))[0][0])
    return shown


@pytest.mark.parametrize("robot", ["ur5", "medrue"])
def test_at_rest_it_reads_the_exact_wrench(robot):
    body = Body(BodyOptions(robot, noise="off"), CYCLE)
    q = body.robot.sample(1, np.random.default_rng(3))[0]
    last = go(body, q, 3.0, 1.5)[-1]
    assert np.abs(body.q - q).max() < 1e-7
    assert np.abs(last - body.simulation.wrench(q[None])[0]).max() < 1e-5
    assert body.newest[1] == pytest.approx((375 + 188) * CYCLE)
    assert body.time == pytest.approx(body.newest[1] - CYCLE)


@pytest.mark.sampled
@pytest.mark.parametrize(
    "effect", ["joint.compliance", "sensor.gain", "cable.pull", "joint.backlash"]
)
def test_effects_at_rest_are_those_of_the_simulated_driver(effect):
    """Two routes through the same poses: the campaign in simulated time, and cycle by cycle."""
    body = Body(BodyOptions("ur5", noise="off", effects=(effect,), seed=2), CYCLE)
    poses = body.robot.sample(3, np.random.default_rng(4))
    with sim.SimDriver(sim.SimOptions("ur5", noise="off", effects=(effect,), seed=2)) as driver:
        plain = Body(BodyOptions("ur5", noise="off"), CYCLE)
        driver.sample(5, 100.0)
        for q in poses:
            driver.move(q).wait()
            block = driver.sample(5, 100.0)
            wanted = np.array([block[c][-1] for c in "fx fy fz tx ty tz".split()])
            seen = go(body, q, 2.0)[-1]
            without = go(plain, q, 2.0)[-1]
            size = np.abs(wanted - without).max()
            assert size > 1e-3
            assert np.abs(seen - wanted).max() < 0.02 * size + 2e-5


@pytest.mark.sampled
@pytest.mark.parametrize("robot", ["ur5", "medrue"])
def test_a_slow_arrival_shows_the_pose_where_it_is(robot):
    """Also after more cycles on the way than are looked back on, and before it counts as a rest."""
    body, plain = (
        Body(BodyOptions(robot, noise="off", effects=e), 0.004)
        for e in (("joint.offset:offset.q6=0.012",), ())
    )
    q = body.robot.sample(1, np.random.default_rng(6))[0]
    start = np.array(body.target)
    for k in range(900):
        s = min((k + 1) / 700, 1.0)
        for one in (body, plain):
            one.step(start + (10 * s**3 - 15 * s**4 + 6 * s**5) * (q - start))
        a, b = (one.readings(np.array([one.time]))[0][0] for one in (body, plain))
        assert np.abs(a - b)[:3].max() < 0.35, k


def test_hysteresis_and_delay_show_on_the_way():
    body = Body(BodyOptions("ur5", noise="off", effects=("sensor.hysteresis",)), CYCLE)
    home, side = body.robot.home, body.robot.home + np.array([0, 0.5, 0, 0.4, 0, 0])
    go(body, home)
    go(body, side)
    first = go(body, home)[-1]
    go(body, home - np.array([0, 0.5, 0, 0.4, 0, 0]))
    second = go(body, home)[-1]
    assert np.abs(first - second).max() > 0.05
    late, prompt = (
        Body(BodyOptions("ur5", noise="off", effects=e), CYCLE)
        for e in (("timing.delay:delay=0.04",), ())
    )
    q = late.robot.home + 0.8
    a, b = (np.array(go(body, q, 4.0, 0.0)) for body in (late, prompt))
    moving = slice(60, 450)
    shifted = np.array(b)[55:445]
    swing = np.ptp(b[moving, 0])
    assert swing > 1.0
    assert np.abs(a[moving] - shifted).max() < 0.03 * swing
    assert np.abs(a[moving] - b[moving]).max() > 0.05 * swing


def test_noise_is_the_sensors_and_seeded():
    bodies = [Body(BodyOptions("ur5", noise="white", seed=s), CYCLE) for s in (1, 1, 2)]
    t = 1.0 + np.arange(4000) * 1e-3
    first, again, other = (body.readings(t)[0] for body in bodies)
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    std = bodies[0].sensor.noise.row_std
    assert np.abs(first.std(axis=0) / std - 1).max() < 0.06
    a, b = (bodies[0].readings(np.array([5.1, late]))[0] for late in (5.2, 5.15))
    assert np.isfinite([a, b]).all() and not np.array_equal(a, b)  # times are moved on


@pytest.mark.parametrize("robot", ["medrue", ur_arm("ur10e")], ids=["medrue", "ur10e"])
def test_a_plate_pushes_back_on_the_tool_and_not_before(robot):
    """Servos give way to one that stands 1 mm above where the tip rests; the load shows it."""
    home = np.array(Body(BodyOptions(robot, noise="off"), CYCLE).robot.home)
    model = Body(BodyOptions(robot, noise="off"), CYCLE).robot
    height = float(Simulation(model, model.parameters.nominal).tip(home[None])[0, 2])
    free, near, pressed = (
        Body(BodyOptions(robot, noise="off"), CYCLE, surface)
        for surface in (None, Plate(height - 0.002), Plate(height + 0.001))
    )
    loads = [go(body, home, 1.0)[-1] for body in (free, near, pressed)]
    assert loads[1] == pytest.approx(loads[0], abs=1e-6)
    assert 5.0 < pressed.push[2] < 20.0  # of 20 N at most
    push = np.linalg.norm(loads[2][:3] - loads[0][:3])
    assert push == pytest.approx(pressed.push[2], rel=0.02)


def test_readings_asked_for_too_early_do_not_delay_later_ones():
    hasty, calm = (Body(BodyOptions("ur5", noise="off"), CYCLE) for _ in range(2))
    hasty.readings(np.array([hasty.newest[1] + 2.0]))  # the loop stood, the sensor went on
    for k in range(60):
        for body in (hasty, calm):
            body.step(body.robot.home + 0.002 * k * np.eye(6)[3])
    at = np.array([calm.newest[1] - 5.5 * CYCLE])
    shown, newest = calm.readings(at)[0][0], calm.readings(np.array([calm.newest[1]]))[0][0]
    assert np.abs(shown - newest).max() > 0.05
    assert hasty.readings(at)[0][0] == pytest.approx(shown, abs=1e-9)


def test_a_motion_pulls_at_the_sensor_as_newton_and_euler_say():
    """Loads between cycles come from one smooth motion, not from jumps at each cycle's begin."""
    body = Body(BodyOptions("ur5", noise="off"), CYCLE)
    t = CYCLE * np.arange(1500)
    wave = [0.3 * (1.0 - np.cos(2.0 * np.pi * (0.3 + 0.05 * j) * t)) for j in range(6)]
    q, load = [], []
    for target in body.robot.home + np.stack(wave, axis=-1):
        body.step(target)
        q.append(body._rows[-1].q)
        load.append(body._rows[-1].load)
    jets = Jet(*(savgol_filter(np.array(q), 11, 5, deriv=k, delta=CYCLE, axis=0) for k in range(3)))
    off = np.array(load) - body.model.true_wrench(jets, body.theta)
    assert np.abs(off[300:-20, :3]).max() < 0.02
    assert np.abs(off[300:-20, 3:]).max() < 0.002
    assert np.ptp(np.array(load)[300:-20], axis=0)[:3].min() > 1.0


OWN = "127.0.1.36"
CABLE = "cable.pull:stiffness=6,pull.x=1.0,pull.z=-1.0"
GAIN = "sensor.gain:gain.fz=0.2"


def made(*effects: str, noise: str = "off", series: str = "cb3", box: str = "off", seed: int = 0):
    setting = {"box": box, "series": series}
    return emulated(
        "ur5", EmulatorOptions(OWN, noise=noise, effects=effects, seed=seed, setting=setting)
    )


def forces(emulator, n: int, step: float = 0.0) -> np.ndarray:
    """actual_TCP_force (n, 6) of control cycles, each a step [rad] further."""
    rows = []
    for k in range(n):
        emulator.controller.arm.q = np.array(emulator.plant.robot.home) + step * k
        emulator.controller.arm._plain = emulator.controller.arm.q.copy()
        emulator.controller.cycle(100.0 + 0.008 * k)
        emulator._outputs.update(1.0, {"actual_TCP_force", "ft_raw_wrench"})
        rows.append(emulator.controller.values["actual_TCP_force"])
    return np.array(rows)


@pytest.mark.sampled
@pytest.mark.parametrize("noise", ["real", "white"])
@pytest.mark.parametrize("series, force, torque", [("cb3", 10.0, 5.0), ("e", 3.5, 0.2)])
def test_its_error_is_of_the_documented_size(noise, series, force, torque):
    found = forces(made(noise=noise, series=series), 2000)
    scatter = found.std(axis=0)
    assert scatter[:3] == pytest.approx(force / 3.0, rel=0.3)
    assert scatter[3:] == pytest.approx(torque / 3.0, rel=0.3)
    slow = found.reshape(40, 50, 6).mean(axis=1).std(axis=0)[:3] * 3.0 / force
    assert (slow > 0.25).all() if noise == "real" else (slow < 0.15).all()


def test_effects_of_the_arm_act_on_its_wrench_and_those_of_the_net_ft_do_not():
    moved = forces(made(CABLE), 200, 0.002) - forces(made(), 200, 0.002)
    assert np.linalg.norm(moved[10, :3]) > 0.5
    assert np.linalg.norm(moved[-1, :3] - moved[10, :3]) > 0.5
    assert np.abs(np.diff(moved[:, :3], axis=0)).max() < 0.2
    plain = forces(made(), 20)
    assert np.abs(plain).max() < 1e-6  # without noise and effects it is zero at rest
    assert forces(made(GAIN), 20) == pytest.approx(plain, abs=1e-12)
    first, again, other = (forces(made(noise="real", seed=s), 20) for s in (1, 1, 2))
    assert (first == again).all() and (first != other).all()


def at_the_tcp(major: int, wrench: np.ndarray, pose: np.ndarray, tcp: np.ndarray) -> np.ndarray:
    """What Universal Robots' ROS 2 driver makes of actual_TCP_force: TCP axes, about the TCP.

    ``transformForceTorque`` of its hardware interface: on a CB3 the axes are turned, from software
    5 on the wrench is also moved from flange to TCP.
    """
    base_tcp, flange_tcp = Rotation.from_rotvec(pose[3:]), Rotation.from_rotvec(tcp[3:])
    if major < 5:
        return np.concatenate([base_tcp.inv().apply(wrench[:3]), base_tcp.inv().apply(wrench[3:])])
    base_flange = base_tcp * flange_tcp.inv()
    force, torque = (base_flange.inv().apply(part) for part in (wrench[:3], wrench[3:]))
    moved = torque - np.cross(tcp[:3], force)
    return np.concatenate([flange_tcp.inv().apply(force), flange_tcp.inv().apply(moved)])


@pytest.mark.parametrize("series, major", [("cb3", 3), ("e", 5), ("x", 10)])
def test_each_generation_refers_its_wrench_to_the_point_that_the_maker_says(series, major):
    """A turned TCP 0.15 m before the flange, no payload set: the tool's whole weight is reported.

    The maker's own client and this package's driver must both get the true load from it.
    """
    emulator = made(series=series, box="on")
    arm, tcp = emulator.controller.arm, np.array([0.02, -0.03, 0.15, 0.3, -0.2, 0.5])
    arm.tcp = tcp.copy()
    arm.estimate.carry(0.0, np.array([0.0, 0.0, 1e-3]))
    wrench = forces(emulator, 3)[-1]
    q, load = np.array(arm.plant.q), np.array(arm.plant.load)
    pose = arm.kinematics.pose(q, tcp)
    assert np.linalg.norm(load[:3]) > 10.0

    turn = Rotation.from_rotvec(tcp[3:])
    true = np.r_[turn.inv().apply(load[:3]),
                 turn.inv().apply(load[3:] - np.cross(tcp[:3], load[:3]))]  # fmt: skip
    assert at_the_tcp(major, wrench, pose, tcp) == pytest.approx(true, abs=1e-9)
    assert at_the_tcp(5 if major < 5 else 3, wrench, pose, tcp) != pytest.approx(true, abs=0.1)

    state = Snapshot(t=1.0, q=tuple(q), pose=tuple(pose), force=tuple(wrench), major=float(major))
    assert own_wrench.reading(state, arm.plant.robot).wrench == pytest.approx(load)
