"""The torque of MedRUE's simulated motors, by hand and through the drives to the driver."""

import mujoco
import numpy as np
import pytest

from medrue_bench import away, until
from robot_emulators.medrue.server import CYCLE_S
from wrenchbed.hardware.drivers.can import CanDriver, CanOptions
from wrenchbed.plant.body import Body, BodyOptions
from wrenchbed.plant.serving import EmulatorOptions, emulated
from wrenchbed.robots.motion_limits import minimum_jerk

HOST = "127.0.4.8"


@pytest.mark.parametrize("joint, within", [(0, 0.01), (5, 0.1)])
def test_what_a_motor_gives_accelerates_what_it_moves(joint, within):
    """From rest on, the integral of a motor's torque is the momentum of its joint."""
    arm = Body(BodyOptions("medrue", noise="off"), CYCLE_S, drives=True)
    model, data = arm.simulation.model, arm.simulation.data
    mujoco.mj_forward(model, data)
    inertias = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertias)
    dof = int(model.joint(arm.robot.joints[joint].name).dofadr[0])
    torques, speeds = [], []
    for k in range(150):
        share = minimum_jerk(np.array(min(1.0, (k + 1) / 100)))
        arm.step(arm.robot.home + share * 0.05 * np.eye(6)[joint])
        torques.append(arm.drives.now.servo[joint])
        speeds.append(arm.qd[joint])
    momentum, v = np.cumsum(torques) * CYCLE_S, np.array(speeds)
    assert float(momentum @ v / (v @ v)) == pytest.approx(inertias[dof, dof], rel=within)


def test_a_motor_holds_what_pushes_and_gives_nothing_at_rest():
    arm = Body(BodyOptions("medrue", noise="off"), CYCLE_S, drives=True)
    for _ in range(50):
        arm.step(arm.robot.home)
    assert np.abs(arm.drives.now.servo).max() < 1e-6
    arm._plant.data.qfrc_applied[0] = 25.0  # on the carriage
    for _ in range(1000):
        arm.step(arm.robot.home)
    assert arm.drives.now.servo[0] == pytest.approx(-25.0, abs=0.1)


@pytest.mark.wire
def test_the_driver_records_currents_of_the_drives():
    """At rest: the reported torque over the drive's constant, weight included."""
    settings = {"port": "0"}
    with emulated("medrue", EmulatorOptions(HOST, noise="off", setting=settings)) as emulator:
        port = emulator.hub.port
        with CanDriver(CanOptions(host=HOST, port=port, effort="current", rate=100.0)) as driver:
            assert until(lambda: driver.health().ok)
            sample = driver.read()
            expected = emulator.plant.body.efforts.torque / [50.0, 0.5, 0.5, 0.5, 0.5, 0.5]
            assert np.abs(sample.evidence["i"] - expected).max() < 0.01
            assert np.abs(expected).max() > 1.0


@pytest.mark.wire
def test_the_drivers_effort_is_what_the_motors_give():
    rated = np.array([200.0] + 5 * [2.0])
    settings = {"port": "0"}
    with emulated("medrue", EmulatorOptions(HOST, noise="off", setting=settings)) as emulator:
        body = emulator.plant.body
        step, given = body.step, [np.zeros(6)]

        def recorded(target, due=0.0):
            step(target, due)
            given.append(np.rint(1000.0 * body.efforts.torque / rated))

        body.step = recorded
        port = emulator.hub.port
        driver = CanDriver(CanOptions(host=HOST, port=port, effort="torque", rate=100.0))
        with driver:
            assert driver.health().counters["arm bus_load"] < 0.9
            assert until(lambda: driver.health().ok)
            driver.move(away(driver))
            told = []
            until(lambda: told.append(driver.read().evidence["tau"]), 0.5)
        rows = np.unique(1000.0 * np.array(told) / rated, axis=0)
        assert np.abs(rows[:, 0]).max() > 5 and len(rows) > 5
        assert np.abs(rows - np.rint(rows)).max() < 1e-6
        known = np.array(given)
        for joint in range(6):
            assert np.isin(np.rint(rows[:, joint]), known[:, joint]).all()
        whole = [(np.rint(row) == known).all(axis=1).any() for row in rows]
        assert np.mean(whole) > 0.8  # the plant may step between two drives' answers
