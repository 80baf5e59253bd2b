"""What the driver of UR robots says, asks and understands, without a robot."""

import contextlib
import socket
import struct
import threading
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from wrenchbed import registry
from wrenchbed.errors import DriverError, LinkError, ParameterError
from wrenchbed.hardware.drivers.rtde import (
    RtdeDriver,
    RtdeOptions,
    dashboard,
    identity,
    outputs,
    status,
    wrench_source,
)
from wrenchbed.hardware.drivers.rtde.identity import Flange
from wrenchbed.hardware.drivers.rtde.shared_state import Snapshot
from wrenchbed.hardware.drivers.rtde.state_worker import FIELDS, RAW
from wrenchbed.hardware.transducers.ur_wrench import UrWrench
from wrenchbed.physics.rotations import quaternion

OK = Snapshot(t=1.0, stamp=1.0, q=(0.1,) * 6, mode=7.0, safety=1.0, runtime=2.0, major=3.0)


@contextlib.contextmanager
def server(port, serve):
    """A TCP server at 127.0.2.9 that treats each connection with `serve`."""
    listener = socket.create_server(("127.0.2.9", port))
    listener.settimeout(5.0)

    def run():
        with contextlib.suppress(OSError):
            link, _ = listener.accept()
            with link:
                link.settimeout(5.0)
                serve(link)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield
    finally:
        listener.close()
        thread.join(6.0)


def seen(**change):
    usual = {
        "state": OK,
        "age": 0.004,
        "worker_gone": "",
        "worker_silent": 0.01,
        "armed": True,
        "control_gone": "",
        "control_silent": 0.01,
        "ended": False,
        "halts": 0.0,
    }
    return status.Observation(**{**usual, **change})


@pytest.mark.parametrize(
    "change, state, words_",
    [
        ({}, "ok", ""),
        ({"age": 0.09}, "stale", "silent or repeats itself"),
        ({"age": 0.09, "worker_silent": 0.3}, "stale", "state worker hangs"),
        ({"age": 0.09, "state": OK._replace(wrong=3.0)}, "stale", "jump faster"),
        ({"age": 1.2}, "lost", "no fresh reading for 1.20 s"),
        ({"worker_gone": "the state worker died by signal 11 (SIGSEGV)"}, "lost", "signal 11"),
        ({"state": None}, "lost", "no state"),
        ({"state": OK._replace(back=3.0)}, "lost", "clock went back by 3 s"),
        ({"state": OK._replace(bits=5.0)}, "stopped", "protective stop"),
        ({"state": OK._replace(safety=3.0)}, "stopped", "protective stop"),
        ({"state": OK._replace(bits=64.0)}, "stopped", "emergency stop"),
        ({"state": OK._replace(bits=256.0)}, "fault", "safety"),
        ({"state": OK._replace(mode=3.0)}, "stopped", "the robot is off"),
        ({"state": OK._replace(mode=5.0)}, "stopped", "idle"),
        ({"state": OK._replace(runtime=4.0)}, "stopped", "program is paused"),
        ({"state": OK._replace(runtime=1.0)}, "stopped", "program is stopped"),
        ({"state": OK._replace(runtime=1.0), "armed": False}, "ok", ""),
        ({"ended": True}, "stopped", "did not take"),
        ({"state": OK._replace(halts=1.0)}, "stopped", "another one plays"),
        ({"control_gone": "the control worker died by signal 11 (SIGSEGV)"}, "lost", "watchdog"),
        ({"control_silent": 1.5}, "lost", "control worker hangs"),
    ],
)
def test_each_trouble_has_a_name(change, state, words_):
    found = status.judge(seen(**change), {})
    assert found.state == state and words_ in found.detail


@settings(max_examples=200)
@given(st.floats(-1, 8), st.floats(0, 13), st.integers(0, 2047))
def test_every_state_of_the_robot_has_words(mode, safety, bits):
    state = OK._replace(mode=mode, safety=safety, bits=float(bits))
    assert status.mode(state) and status.safety(state) and status.program(state)
    trouble = status.problem(state)
    assert trouble is None or (trouble[0] in ("stopped", "fault") and trouble[1])


def test_the_dashboard_answers_within_a_deadline():
    def serve(link):
        link.sendall(b"Connected: Universal Robots Dashboard Server\n")
        assert link.recv(100) == b"stop\n"
        link.sendall(b"Stopped\n")

    with server(dashboard.PORT, serve):
        assert dashboard.request("127.0.2.9", "stop") == "Stopped"
    with server(dashboard.PORT, lambda link: time.sleep(0.5)):
        begun = time.monotonic()
        with pytest.raises(LinkError, match="no answer to 'stop'"):
            dashboard.request("127.0.2.9", "stop", 0.2)
        assert time.monotonic() - begun < 0.4
    with pytest.raises(LinkError, match="refused"):
        dashboard.request("127.0.2.9", "stop", 0.2)


def test_a_controller_is_asked_for_its_version_first():
    def serve(link):
        link.recv(5)
        link.sendall(b"\x00\x04V\x01" + b"\x00\x07M\x01a\x01b")
        link.recv(3)
        link.sendall(b"\x00\x13v" + b"".join(n.to_bytes(4, "big") for n in (3, 15, 8, 1)))

    with server(outputs.PORT, serve):
        assert outputs.controller_version("127.0.2.9", 1.0) == (3, 15, 8, 1)


@pytest.mark.parametrize(
    "answer, error",
    [
        (b"\x00\x01", outputs.Unfit),
        (b"\x00\x02V", outputs.Unfit),
        (b"\xff\xffV" * 3, outputs.Unfit),
        (b"\x00\x04V\x00", outputs.Unfit),
        (b"\x00\x04Q\x01", outputs.Unfit),
        (b"\x00", OSError),
        (b"", OSError),
    ],
)
def test_a_controller_that_answers_nonsense_is_refused(answer, error):
    def serve(link):
        link.recv(5)
        link.sendall(answer if len(answer) != 2 else answer + b"V")

    with server(outputs.PORT, serve), pytest.raises(error):
        outputs.controller_version("127.0.2.9", 1.0)


def test_a_silent_controller_is_named_in_time():
    begun = time.monotonic()
    with server(outputs.PORT, lambda link: time.sleep(0.6)), pytest.raises(TimeoutError):
        outputs.controller_version("127.0.2.9", 0.2)
    assert time.monotonic() - begun < 1.0


def packet(kind: bytes, body: bytes) -> bytes:
    return (3 + len(body)).to_bytes(2, "big") + kind + body


def controller(lacks: str = "", start: bytes = b"\x01"):
    """Serves seven outputs as an old controller does that lacks one of them."""
    kinds = {"timestamp": "DOUBLE", "payload": "DOUBLE", "payload_cog": "VECTOR3D",
             "tcp_offset": "VECTOR6D", "safety_mode": "INT32", "robot_mode": "INT32",
             "speed_scaling": "DOUBLE"}  # fmt: skip
    values = {"timestamp": (41.5,), "payload": (1.25,), "payload_cog": (0.0, 0.01, 0.05),
              "tcp_offset": (0.0, 0.0, 0.1, 0.0, 0.0, 0.5), "safety_mode": (3,),
              "robot_mode": (7,), "speed_scaling": (0.5,)}  # fmt: skip

    def serve(link):
        while request := link.recv(3):
            body = link.recv(int.from_bytes(request[:2], "big") - 3) if request[1] > 3 else b""
            match request[2:]:
                case b"V":
                    link.sendall(packet(b"V", b"\x01"))
                case b"v":
                    version = b"".join(n.to_bytes(4, "big") for n in (3, 4, 1, 2))
                    link.sendall(packet(b"v", version))
                case b"O":
                    names = body[8:].decode().split(",")
                    told = ["NOT_FOUND" if n == lacks else kinds[n] for n in names]
                    link.sendall(packet(b"O", b"\x01" + ",".join(told).encode()))
                case b"S":
                    link.sendall(packet(b"S", start))
                    flat = b"".join(
                        struct.pack(">i" if kinds[n] == "INT32" else ">d", v)
                        for n in names for v in values[n]
                    )  # fmt: skip
                    link.sendall(packet(b"M", b"\x01a\x01b\x03") + packet(b"U", b"\x01" + flat))

    return serve


def test_how_the_controller_is_set_up_is_read_by_its_own_types():
    with server(outputs.PORT, controller()):
        assert identity.settings("127.0.2.9") == {
            "payload": 1.25, "payload_cog": [0.0, 0.01, 0.05], "time": 41.5,
            "tcp_offset": [0.0, 0.0, 0.1, 0.0, 0.0, 0.5], "safety_mode": "protective stop",
            "robot_mode": "running", "speed_scaling": 0.5,
        }  # fmt: skip


def test_an_older_controller_says_less_and_no_answer_is_no_settings():
    with server(outputs.PORT, controller(lacks="payload_cog")):
        found = identity.settings("127.0.2.9")
    assert "payload_cog" not in found and found["payload"] == 1.25 and found["time"] == 41.5
    with server(outputs.PORT, controller(start=b"\x00")):
        assert identity.settings("127.0.2.9") == {}
    assert identity.settings("127.0.2.9") == {}


def test_only_what_ur_rtde_decodes_is_asked_for():
    """Its table in src/robot_state.cpp, release 1.6.5."""
    table = set(
        "timestamp target_q target_qd target_qdd target_current target_moment actual_q actual_qd "
        "actual_current actual_TCP_pose actual_TCP_speed actual_TCP_force target_TCP_pose "
        "robot_mode joint_mode safety_mode speed_scaling target_speed_fraction runtime_state "
        "robot_status_bits safety_status_bits joint_temperatures ft_raw_wrench".split()
    )
    assert {*FIELDS, RAW} <= table


def own(state):
    return wrench_source.reading(state, registry.load("robots", "ur5"))


def test_the_own_wrench_comes_in_the_sensors_axes():
    """A force at the TCP, 0.1 m along the flange's z, turns about the sensor's origin."""
    robot = registry.load("robots", "ur5")
    q = np.array([0.3, -1.2, -1.5, -1.1, 1.4, 0.5])
    rotation, origin = (a[0] for a in robot.sensor_pose(q[None], robot.parameters.nominal))
    force, torque = np.array([3.0, -2.0, 7.0]), np.array([0.1, 0.2, -0.3])
    tcp = origin + rotation @ [0.0, 0.0, 0.1]
    given_ = (*(rotation @ force), *(rotation @ torque))
    state = OK._replace(q=tuple(q), pose=(*tcp, 0.0, 0.0, 0.0), force=given_)
    expected = np.concatenate([force, torque + np.cross([0.0, 0.0, 0.1], force)])
    assert own(state).wrench == pytest.approx(expected, abs=1e-9)
    series_e = state._replace(major=5.0)
    assert own(series_e).wrench == pytest.approx([*force, *torque], abs=1e-9)
    raw = series_e._replace(raw=(1.0, 2.0, 3.0, 4.0, 5.0, 6.0))
    assert own(raw).wrench == pytest.approx([1, 2, 3, 4, 5, 6])
    assert (
        wrench_source.facts(state, {})["reference"] == "tcp"
        and wrench_source.facts(raw, {})["frame"] == "flange"
    )


def test_the_own_wrench_is_a_transducer():
    now = time.monotonic() + 60.0  # whatever the test's machine does meanwhile
    states = iter([OK._replace(t=now - 0.45 + 0.05 * k, received=float(k)) for k in range(9)])
    latest = OK._replace(t=now - 0.6)

    def source():
        return own(latest)

    wrench = UrWrench(UrWrench.options(source=source))
    with wrench:
        for latest in states:  # noqa: B007
            sample = wrench.read()
            assert sample.fresh and not wrench.read().fresh
        assert (sample.frame, sample.reference) == ("sensor", "sensor")
        assert wrench.at(now - 0.23).wrench.shape == (6,)
        assert wrench.at(now - 0.23).age == pytest.approx(0.02, abs=1e-6)
        assert wrench.at(now - 0.55) is None and wrench.at(now - 9.0) is None
        assert wrench.health().state == "ok"
        with pytest.raises(DriverError, match="cannot change its zero"):
            wrench.zero()
    alone = registry.load("transducers", "ur-wrench")()
    with pytest.raises(DriverError, match="driver 'rtde' only"):
        alone.connect()


def test_the_flange_is_told_where_the_tcp_is_there():
    robot = registry.load("robots", "ur5")
    q = np.array([0.3, -1.2, -1.5, -1.1, 1.4, 0.5])
    rotation, origin = (a[0] for a in robot.sensor_pose(q[None], robot.parameters.nominal))
    turn = Rotation.from_matrix(rotation).as_rotvec()
    state = OK._replace(q=tuple(q), pose=(*origin, *turn))
    assert Flange(robot).pose(state) == pytest.approx([*origin, *quaternion(rotation)])
    elsewhere = state._replace(pose=(*(origin + rotation @ [0.0, 0.0, 0.1]), *turn))
    assert Flange(robot).pose(elsewhere) is None
    turned = state._replace(pose=(*origin, turn[0] + 0.1, *turn[1:]))
    assert Flange(robot).pose(turned) is None


@pytest.mark.parametrize(
    "sensor", ["nonsense", "netft://", "netft://h?x=1", "netft://h:x", "ftp://h"]
)
def test_a_wrong_sensor_is_refused(sensor):
    with pytest.raises(ParameterError, match="netft"):
        RtdeDriver(RtdeOptions(sensor=sensor))


@pytest.mark.parametrize(
    "change", [{"frequency": 0.0}, {"watchdog_hz": 500.0}, {"attempts": 0}, {"connect_s": -1.0}]
)
def test_wrong_options_are_refused(change):
    with pytest.raises(ParameterError):
        RtdeOptions(**change)


def test_what_the_robot_is_can_be_read_while_disconnected():
    driver = RtdeDriver(RtdeOptions(sensor="rtde"))
    assert driver.robot.name == "ur5" and driver.live and driver.source == "ur_rtde"
    assert driver.health().state == "closed"
    assert driver.metadata("static", 100.0).source == "ur_rtde"
    with pytest.raises(ParameterError, match="address"):
        driver.connect()
    with pytest.raises(DriverError, match="connect"):
        driver.read()
    driver.close()


def test_no_robot_is_named_within_the_deadline():
    driver = RtdeDriver(RtdeOptions(host="127.0.2.8", sensor="rtde", connect_s=2.0, attempts=3))
    begun = time.monotonic()
    with pytest.raises(LinkError, match="refused"):
        driver.connect()
    assert time.monotonic() - begun < 4.0
    driver.close()


def test_a_controller_that_is_silent_at_connection_is_named():
    with server(outputs.PORT, lambda link: time.sleep(3.0)):
        driver = RtdeDriver(RtdeOptions(host="127.0.2.9", sensor="rtde", connect_s=2.5, attempts=1))
        with pytest.raises(LinkError, match="does not answer|timed out|did not connect"):
            driver.connect()
