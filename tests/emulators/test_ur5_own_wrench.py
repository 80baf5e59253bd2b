"""The UR5 twin's own wrench: its effects and its error, apart from the Net F/T's."""

import numpy as np
import pytest

from wrenchbed.emulators.base import emulator
from wrenchbed.emulators.ur5 import EMULATOR

HOST = "127.0.1.36"
CABLE = "cable.pull:stiffness=6,pull.x=1.0,pull.z=-1.0"
GAIN = "sensor.gain:gain.fz=0.2"


def made(*effects: str, noise: str = "off", series: str = "cb3", box: str = "off", seed: int = 0):
    setting = {"box": box, "series": series}
    return EMULATOR(
        emulator.EmulatorOptions(HOST, noise=noise, effects=effects, seed=seed, setting=setting)
    )


def forces(twin, n: int, step: float = 0.0) -> np.ndarray:
    """actual_TCP_force (n, 6) of control cycles, each a step [rad] further."""
    rows = []
    for k in range(n):
        twin.controller.arm.q = np.array(twin.body.robot.home) + step * k
        twin.controller.arm._plain = twin.controller.arm.q.copy()
        twin.controller.cycle(100.0 + 0.008 * k)
        twin._outputs.update(1.0, {"actual_TCP_force", "ft_raw_wrench"})
        rows.append(twin.controller.values["actual_TCP_force"])
    return np.array(rows)


def test_without_noise_and_effects_it_is_zero_at_rest():
    assert np.abs(forces(made(), 50)).max() < 1e-6


@pytest.mark.parametrize("noise", ["real", "white"])
@pytest.mark.parametrize("series, force, torque", [("cb3", 10.0, 5.0), ("e", 3.5, 0.2)])
def test_its_error_is_of_the_documented_size(noise, series, force, torque):
    found = forces(made(noise=noise, series=series), 4000)
    scatter = found.std(axis=0)
    assert scatter[:3] == pytest.approx(force / 3.0, rel=0.3)
    assert scatter[3:] == pytest.approx(torque / 3.0, rel=0.3)
    slow = found.reshape(40, 100, 6).mean(axis=1).std(axis=0)[:3] * 3.0 / force
    assert (slow > 0.25).all() if noise == "real" else (slow < 0.15).all()


def test_its_error_is_seeded():
    first, again, other = (forces(made(noise="real", seed=s), 20) for s in (1, 1, 2))
    assert (first == again).all() and (first != other).all()


def test_its_error_is_not_that_of_the_net_ft():
    twin = made(noise="white", box="on")
    shown, own = [], []
    for k in range(400):
        forces(twin, 1)
        own.append(twin.controller.arm.load)
        shown.append(twin.body.readings(np.array([0.008 * (k + 1)]))[0][0])
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


def test_what_the_net_ft_alone_makes_of_its_load_is_not_felt():
    assert forces(made(GAIN), 20) == pytest.approx(forces(made(), 20), abs=1e-12)


def test_both_readings_of_an_e_series_are_of_one_sensor():
    twin = made(CABLE, noise="real", series="e", box="on")
    force = forces(twin, 30)[-1]
    raw = np.array(twin.controller.values["ft_raw_wrench"])
    arm = twin.controller.arm
    rotation, _ = arm.kinematics.flange(arm.body.q)
    weight = arm.estimate.payload.mass * arm.estimate.gravity
    assert rotation @ raw[:3] - weight == pytest.approx(force[:3], abs=1e-9)
    assert np.abs(raw - twin.body.load).max() > 0.1
