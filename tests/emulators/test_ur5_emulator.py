"""Unmodified ur_rtde interfaces against the UR5's emulator in a process of its own."""

import time
from contextlib import nullcontext

import numpy as np
import pytest

import emulator_process
from ur5_alone import alone
from ur5_socket import Client
from wrenchbed import registry
from wrenchbed.hardware.device_base import wait_until as until

pytestmark = pytest.mark.wire

rtde_control = pytest.importorskip("rtde_control")
rtde_receive = pytest.importorskip("rtde_receive")
rtde_io = pytest.importorskip("rtde_io")
dashboard_client = pytest.importorskip("dashboard_client")

CB3 = "127.0.1.21"
ROBOT = registry.load("robots", "ur5")
HOME = np.array(ROBOT.home)


@pytest.fixture(scope="module")
def cb3():
    more = ("--table", "0.25", "--noise", "off", "--set", "box=off")
    with emulator_process.running("ur5", CB3, *more) as emulator:
        yield emulator


def receiving(host):
    """An interface that ends with the process of its test, as disconnect() takes half a second."""
    return nullcontext(rtde_receive.RTDEReceiveInterface(host))


def controlling(host, *more):
    return nullcontext(rtde_control.RTDEControlInterface(host, *more))


def dashboard(host):
    client = dashboard_client.DashboardClient(host)
    client.connect()
    return nullcontext(client)


def expected_pose(q):
    rotation, position = ROBOT.flange_pose(np.array(q)[None], ROBOT.parameters.nominal)
    return rotation[0], position[0]


@pytest.mark.slow
@alone
def test_the_receive_interface_reads_every_default_field(cb3):
    with receiving(CB3) as robot:
        assert robot.getActualQ() == pytest.approx(HOME, abs=0.5)
        assert robot.getRobotMode() == 7 and robot.getSafetyMode() == 1
        assert robot.getSafetyStatusBits() == 1 and robot.getRobotStatus() & 1
        assert robot.getPayload() == pytest.approx(1.35)
        assert robot.getPayloadCog() == pytest.approx([0.004, -0.006, 0.071])
        assert all(20.0 < t < 50.0 for t in robot.getJointTemperatures())
        assert robot.getActualMainVoltage() == pytest.approx(48.0)
        assert robot.getJointMode() == [253] * 6
        assert np.linalg.norm(robot.getActualToolAccelerometer()) == pytest.approx(9.80665)
        assert np.abs(robot.getActualCurrent()).max() > 0.5
        _, position = expected_pose(robot.getActualQ())
        assert robot.getActualTCPPose()[:3] == pytest.approx(position, abs=1e-9)
        first, begun = robot.getTimestamp(), time.monotonic()
        time.sleep(0.3)
        passed = time.monotonic() - begun
        assert robot.getTimestamp() - first == pytest.approx(passed, abs=0.1)


def moves_and_answers(arm, robot):
    goal = HOME + 0.15
    assert arm.moveJ(goal.tolist(), 3.0, 10.0)
    assert until(lambda: np.abs(np.array(robot.getActualQ()) - goal).max() < 1e-4, 0.5)
    pose = np.array(arm.getForwardKinematics())
    assert pose == pytest.approx(robot.getActualTCPPose(), abs=1e-4)
    pose[2] += 0.05
    assert arm.moveL(pose.tolist(), 0.5, 5.0)
    assert until(lambda: np.allclose(robot.getActualTCPPose(), pose, atol=1e-4), 0.5)
    solved = arm.getInverseKinematics(pose.tolist())
    assert solved == pytest.approx(robot.getActualQ(), abs=1e-3)
    both = arm.poseTrans([1, 0, 0, 0, 0, 0], [0, 2, 0, 0, 0, 0])
    assert both == pytest.approx([1, 2, 0, 0, 0, 0])
    assert arm.isJointsWithinSafetyLimits(HOME.tolist())
    assert not arm.isPoseWithinSafetyLimits([3.0, 0, 0, 0, 0, 0])
    assert arm.setTcp([0, 0, 0.1, 0, 0, 0])
    assert arm.getTCPOffset() == pytest.approx([0, 0, 0.1, 0, 0, 0])
    rotation, position = expected_pose(robot.getActualQ())
    tip = position + 0.1 * rotation[:, 2]
    assert until(lambda: np.allclose(robot.getActualTCPPose()[:3], tip, atol=1e-4), 0.5)
    assert arm.setTcp([0] * 6)
    assert until(arm.isSteady, 1.0)


def moves_beside_and_along_paths(arm, robot):
    assert arm.moveJ((HOME + 0.3).tolist(), 0.5, 2.0, True)
    assert until(lambda: arm.getAsyncOperationProgress() == 0, 0.5)
    arm.stopJ(4.0)
    assert until(lambda: np.abs(robot.getActualQd()).max() < 1e-3, 1.0)
    assert arm.getAsyncOperationProgress() < 0
    path = [[*(HOME + a).tolist(), 3.0, 10.0, 0.0] for a in (0.1, 0.0)]
    assert arm.moveJ(path)
    assert until(lambda: np.abs(np.array(robot.getActualQ()) - HOME).max() < 1e-3, 0.5)


def streams(arm, robot):
    assert arm.moveJ(HOME.tolist(), 3.0, 10.0)
    for k in range(40):
        goal = HOME + 0.002 * k
        assert arm.servoJ(goal.tolist(), 0, 0, 0.008, 0.05, 300)
        time.sleep(0.008)
    assert until(lambda: np.abs(np.array(robot.getTargetQ()) - goal).max() < 1e-3, 0.5)
    assert arm.servoStop()
    assert arm.speedJ([0.1] * 6, 1.0, 0.1)
    assert until(lambda: np.abs(np.array(robot.getTargetQd()) - 0.1).max() < 1e-6, 1.0)
    assert arm.speedStop()
    assert until(lambda: np.abs(robot.getTargetQd()).max() < 1e-6, 1.0)
    assert arm.speedL([0, 0, 0.02, 0, 0, 0], 1.0, 0.1)
    assert until(lambda: abs(robot.getTargetTCPSpeed()[2] - 0.02) < 1e-4, 1.0)
    assert arm.speedStop()


@alone
def test_a_client_asks_moves_and_streams_and_keeps_others_out(cb3):
    with controlling(CB3) as arm, receiving(CB3) as robot:
        moves_and_answers(arm, robot)
        moves_beside_and_along_paths(arm, robot)
        streams(arm, robot)
        with pytest.raises(RuntimeError, match="already in use"):
            rtde_control.RTDEControlInterface(CB3)


@alone
def test_the_watchdog_and_a_new_upload(cb3):
    with controlling(CB3) as arm:
        assert arm.setWatchdog(10.0)
        for _ in range(4):
            time.sleep(0.05)
            assert arm.kickWatchdog()
        assert arm.isProgramRunning()
        assert until(lambda: not arm.isProgramRunning(), 0.5)
        assert not arm.moveJ(HOME.tolist())
        assert arm.reuploadScript()
        assert until(arm.isProgramRunning, 0.5)
        assert arm.moveJ(HOME.tolist())
        assert arm.sendCustomScriptFunction("words", 'textmsg("hello")')
        assert arm.isProgramRunning()


@pytest.mark.slow
@alone
def test_upper_registers_and_lower_ones_side_by_side(cb3):
    flags = rtde_control.RTDEControlInterface
    upper = flags.FLAG_UPLOAD_SCRIPT | flags.FLAG_UPPER_RANGE_REGISTERS
    with controlling(CB3, 125.0, upper) as arm, receiving(CB3) as robot, dashboard(CB3) as desk:
        assert arm.moveJ((HOME + 0.1).tolist(), 3.0, 10.0)
        goal = pytest.approx(HOME + 0.1, abs=1e-2)
        assert until(lambda: robot.getActualQ() == goal, 0.5)
        desk.stop()


@alone
def test_inputs_and_outputs(cb3):
    terminals = rtde_io.RTDEIOInterface(CB3)
    with receiving(CB3) as robot:
        assert terminals.setStandardDigitalOut(3, True)
        assert terminals.setToolDigitalOut(1, True)
        assert terminals.setSpeedSlider(0.5)
        assert terminals.setAnalogOutputVoltage(0, 0.25)
        assert terminals.setAnalogOutputCurrent(1, 0.5)
        assert until(lambda: robot.getActualDigitalOutputBits() == 1 << 3 | 1 << 17, 0.5)
        assert until(lambda: robot.getTargetSpeedFraction() == 0.5, 0.5)
        assert until(lambda: robot.getStandardAnalogOutput1() == pytest.approx(0.012), 0.5)  # A
        assert robot.getStandardAnalogOutput0() == pytest.approx(2.5)  # V
        assert terminals.setStandardDigitalOut(3, False) and terminals.setSpeedSlider(1.0)
        assert until(lambda: robot.getActualDigitalOutputBits() == 1 << 17, 0.5)


def test_the_stream_keeps_its_rate(cb3):
    with Client(CB3) as client:
        client.stream("timestamp,actual_q")
        first, begun = client.newest()[0], time.monotonic()
        stamps = [client.state()[0] for _ in range(100)]
        assert stamps[-1] - first == pytest.approx(time.monotonic() - begun, abs=0.03)
        assert np.median(np.diff(stamps)) == pytest.approx(0.008)


@pytest.mark.slow
@alone
def test_power_off_and_on_by_dashboard(cb3):
    with receiving(CB3) as robot, dashboard(CB3) as desk:
        desk.powerOff()
        assert until(lambda: robot.getRobotMode() == 3, 0.5)
        desk.powerOn()
        assert until(lambda: desk.robotmode() == "Robotmode: IDLE", 2.0)
        desk.brakeRelease()
        assert until(lambda: robot.getRobotMode() == 7, 2.0)
        assert desk.getRobotModel() == "UR5"


@pytest.mark.slow
@alone
def test_a_protective_stop_cannot_be_unlocked_at_once(cb3):
    with controlling(CB3) as arm, receiving(CB3) as robot, dashboard(CB3) as desk:
        cb3.fault("robot", "protective_stop")
        assert until(lambda: robot.getSafetyMode() == 3, 0.5)
        assert not arm.moveJ(HOME.tolist())
        assert desk.safetymode() == "Safetymode: PROTECTIVE_STOP"
        assert not desk.running() and desk.programState().startswith("PAUSED")
        with pytest.raises(RuntimeError, match="5s"):
            desk.unlockProtectiveStop()
