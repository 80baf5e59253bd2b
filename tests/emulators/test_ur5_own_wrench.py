"""The UR5 emulator's own wrench: its effects and its error, apart from the Net F/T's."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrenchbed.hardware.drivers.rtde import own_wrench
from wrenchbed.hardware.drivers.rtde.states import Snapshot
from wrenchbed.plant.serving import EmulatorOptions, emulated

HOST = "127.0.1.36"
CABLE = "cable.pull:stiffness=6,pull.x=1.0,pull.z=-1.0"
GAIN = "sensor.gain:gain.fz=0.2"


def made(*effects: str, noise: str = "off", series: str = "cb3", box: str = "off", seed: int = 0):
    setting = {"box": box, "series": series}
    return emulated(
        "ur5", EmulatorOptions(HOST, noise=noise, effects=effects, seed=seed, setting=setting)
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
    found = forces(made(noise=noise, series=series), 4000)
    scatter = found.std(axis=0)
    assert scatter[:3] == pytest.approx(force / 3.0, rel=0.3)
    assert scatter[3:] == pytest.approx(torque / 3.0, rel=0.3)
    slow = found.reshape(40, 100, 6).mean(axis=1).std(axis=0)[:3] * 3.0 / force
    assert (slow > 0.25).all() if noise == "real" else (slow < 0.15).all()


def test_its_error_is_not_that_of_the_net_ft():
    emulator = made(noise="white", box="on")
    shown, own = [], []
    for k in range(400):
        forces(emulator, 1)
        own.append(emulator.controller.arm.load)
        shown.append(emulator.plant.readings(np.array([0.008 * (k + 1)]))[0][0])
    for lag in range(-4, 5):
        for j in range(3):
            first, second = (np.array(rows)[:, j] for rows in (shown, own))
            first, second = first[4 + lag : 396 + lag], second[4:396]
            assert abs(np.corrcoef(first, second)[0, 1]) < 0.25


def test_a_cable_pulls_on_it_in_each_pose_anew():
    moved = forces(made(CABLE), 200, 0.002) - forces(made(), 200, 0.002)
    assert np.linalg.norm(moved[10, :3]) > 0.5
    assert np.linalg.norm(moved[-1, :3] - moved[10, :3]) > 0.5
    assert np.abs(np.diff(moved[:, :3], axis=0)).max() < 0.2


def test_effects_of_the_net_ft_do_not_act_on_the_arms_wrench():
    plain = forces(made(), 20)
    assert np.abs(plain).max() < 1e-6  # without noise and effects it is zero at rest
    assert forces(made(GAIN), 20) == pytest.approx(plain, abs=1e-12)
    first, again, other = (forces(made(noise="real", seed=s), 20) for s in (1, 1, 2))
    assert (first == again).all() and (first != other).all()


def test_both_readings_of_an_e_series_are_of_one_sensor():
    emulator = made(CABLE, noise="real", series="e", box="on")
    force = forces(emulator, 30)[-1]
    raw = np.array(emulator.controller.values["ft_raw_wrench"])
    arm = emulator.controller.arm
    rotation, _ = arm.kinematics.flange(arm.plant.q)
    weight = arm.estimate.payload.mass * arm.estimate.gravity
    assert rotation @ raw[:3] - weight == pytest.approx(force[:3], abs=1e-9)
    assert np.abs(raw - emulator.plant.load).max() > 0.1


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
