"""The parts of the driver of UR robots that need no robot: messages, states, words, options."""

import contextlib
import math
import random
import socket
import struct
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wrenchbed import registry
from wrenchbed.errors import DriverError, LinkError, ParameterError, StoppedError
from wrenchbed.hardware.drivers.rtde import (
    RtdeDriver,
    RtdeOptions,
    identity,
    own_wrench,
    states,
    ur_health,
)
from wrenchbed.hardware.drivers.rtde.control_worker import (
    Closed,
    MessageChannel,
    SharedNumbers,
    is_six_numbers,
)
from wrenchbed.hardware.drivers.rtde.driver import Followed, trapezoid
from wrenchbed.hardware.drivers.rtde.states import Snapshot, StateReceiver, implausible

HOST = "127.0.2.9"
OK = Snapshot(t=1.0, stamp=1.0, q=(0.1,) * 6, mode=7.0, safety=1.0, runtime=2.0, major=3.0)
HAMMER = """
import sys, time
sys.path.insert(0, sys.argv[2])
from control_worker import SharedNumbers
shared = SharedNumbers(int(sys.argv[1]))
end = time.monotonic() + 0.4
while time.monotonic() < end:
    shared.beat("driver")
"""


@pytest.fixture
def shared():
    memory = SharedNumbers.create()
    yield memory
    memory.close()
    memory.close()


def test_a_heartbeat_ages_and_is_never_seen_half_written(shared):
    assert shared.silence("driver") > 1.0
    shared.beat("driver")
    assert shared.silence("driver") < 0.05 < shared.silence("control")
    folder = states.__file__.rpartition("/")[0]
    with subprocess.Popen(
        [sys.executable, "-c", HAMMER, str(shared.descriptor), folder],
        pass_fds=(shared.descriptor,),
    ) as writer:
        while writer.poll() is None:
            assert 0.0 <= shared.silence("driver") < 2.0
    assert writer.returncode == 0 and shared.get("speed") == 0.0


def test_messages_keep_their_borders_and_an_end_is_told():
    one, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    mine = MessageChannel(one)
    assert mine.send({"a": 1}) and mine.send({"b": [2.0]})
    assert other.recv(100) == b'{"a": 1}' and other.recv(100) == b'{"b": [2.0]}'
    assert mine.receive(0.0) is None
    other.close()
    with pytest.raises(Closed):
        mine.receive(0.1)
    assert not mine.send({"a": 1})
    mine.close()


@given(st.floats(1e-6, 6.0), st.floats(0.2, 30.0), st.floats(0.05, 3.14))
def test_a_move_uses_no_more_than_its_speed(distance, seconds, top):
    speed, acceleration = trapezoid(distance, seconds, top)
    assert speed <= max(top, 0.01) and 0.05 <= acceleration <= 15.0
    if top >= 1.5 * distance / seconds > 0.01 and 4.5 * distance / seconds**2 > 0.05:
        took = distance / speed + speed / acceleration
        assert took == pytest.approx(seconds, rel=1e-6) or acceleration == 15.0


def test_only_six_finite_angles_are_sent():
    assert is_six_numbers([0.0, 1, -2.0, 3.0, 4.0, 5.0])
    for q in (None, [None] * 6, ["1"] * 6, (0.0,) * 6, [0.0] * 5, [0.0] * 5 + [math.nan]):
        assert not is_six_numbers(q)


@pytest.mark.parametrize("gain, why", [(1.0, ""), (0.0, "does not follow")])
def test_targets_that_are_dropped_are_noticed_and_late_ones_are_followed(gain, why):
    followed, rng, said = Followed(), random.Random(3), ""
    for k in range(120):
        sent = np.full(6, 0.2 * math.sin(0.05 * k))
        late = np.full(6, gain * 0.2 * math.sin(0.05 * max(0, k - 12)) + rng.gauss(0.0, 1e-5))
        said = said or followed.add(0.008 * k, sent, late)
    assert why in said and bool(why) == bool(said)


@pytest.mark.parametrize(
    "change, wrong",
    [
        ({}, ""), ({"q": (float("nan"),) * 6}, "finite"), ({"force": (math.inf,) * 6}, "finite"),
        ({"q": (1e86,) * 6}, "values"), ({"mode": 99.0}, "values"), ({"safety": 0.0}, "values"),
        ({"runtime": 1e9}, "values"), ({"q": (0.5,) * 6}, "jump"), ({"stamp": 0.992}, "go back"),
        ({"stamp": -0.5, "q": (0.5,) * 6}, ""), ({"qd": (60.0,) * 6}, "values"),
        ({"stamp": 0.0, "current": (5e30,) * 6}, "values"),
        ({"stamp": 0.0, "q": (3.4e-322,) * 6}, "values"),
        ({"target_moment": (-1.5e36,) * 6}, "values"), ({"temperatures": (1e9,) * 6}, "values"),
    ],
)  # fmt: skip
def test_what_no_robot_sends_is_refused(change, wrong):
    why = implausible(OK._replace(**{"t": 1.008, "stamp": 1.008} | change), OK)
    assert wrong in why and bool(wrong) == bool(why)


def judged(state, stream="", **known):
    control = {"gone": "", "silent": 0.01, "ended": False, "halts": 0.0} | known
    return ur_health.judge(state, stream, ur_health.Control(**control), {})


@pytest.mark.parametrize(
    "age, change, more, expected, words",
    [
        (0.0, {}, {}, "ok", ""),
        (0.09, {}, {}, "stale", "silent or repeats itself"),
        (0.09, {"wrong": "joints that jump faster than any robot"}, {}, "stale", "jump faster"),
        (1.2, {}, {}, "lost", "no fresh reading for 1.2"),
        (0.0, {}, {"stream": "the stream of states ended"}, "lost", "stream of states ended"),
        (0.0, {"back": 3.0}, {}, "lost", "clock went back by 3 s"),
        (0.0, {"bits": 5.0}, {}, "stopped", "protective stop"),
        (0.0, {"bits": 64.0}, {}, "stopped", "emergency stop"),
        (0.0, {"bits": 256.0}, {}, "fault", "safety"),
        (0.0, {"mode": 3.0}, {}, "stopped", "the robot is off"),
        (0.0, {"runtime": 4.0}, {}, "stopped", "program is paused"),
        (0.0, {"halts": 1.0}, {}, "stopped", "another one plays"),
    ],
)
def test_each_trouble_has_a_name(age, change, more, expected, words):
    health = judged(OK._replace(t=time.monotonic() - age, **change), **more)
    assert health.state == expected and words in health.detail


def test_the_process_that_commands_is_judged_where_there_is_one():
    now = OK._replace(t=time.monotonic() + 9.0)
    assert judged(None).state == "lost" and "no state" in judged(None).detail
    assert "watchdog" in judged(now, gone="the control process died by signal 11").detail
    assert "hangs" in judged(now, silent=1.5).detail
    assert "did not take" in judged(now, ended=True).detail
    assert ur_health.judge(now._replace(runtime=1.0), "", None, {}).ok


@settings(max_examples=200)
@given(st.floats(-1, 8), st.floats(0, 13), st.integers(0, 2047))
def test_every_state_of_the_robot_has_words(mode, safety, bits):
    state = OK._replace(mode=mode, safety=safety, bits=float(bits))
    assert ur_health.mode(state) and ur_health.safety(state) and ur_health.program(state)
    trouble = ur_health.problem(state)
    assert trouble is None or (trouble[0] in ("stopped", "fault") and trouble[1])


@contextlib.contextmanager
def server(port, serve):
    """A TCP server that treats each connection with `serve`."""
    listener = socket.create_server((HOST, port))
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


def test_the_dashboard_answers_within_a_deadline():
    def serve(link):
        link.sendall(b"Connected: Universal Robots Dashboard Server\n")
        assert link.recv(100) == b"stop\n"
        link.sendall(b"Stopped\n")

    with server(ur_health.PORT, serve):
        assert ur_health.request(HOST, "stop") == "Stopped"

    def trickle(link):
        for _ in range(40):
            link.sendall(b"a")
            time.sleep(0.05)

    for late in (lambda link: time.sleep(0.5), trickle):
        with server(ur_health.PORT, late):
            begun = time.monotonic()
            with pytest.raises(LinkError, match="no answer to 'stop'"):
                ur_health.request(HOST, "stop", 0.2)
            assert time.monotonic() - begun < 0.4
    with pytest.raises(LinkError, match="refused"):
        ur_health.request(HOST, "stop", 0.2)
    with pytest.raises(LinkError, match="no name of a host"):
        ur_health.request("../..", "stop", 0.2)


def test_a_protective_stop_is_unlocked_after_five_seconds_and_its_program_ended(monkeypatch):
    """The program is only paused; the controller refuses to unlock within 5 s."""
    now, said = [103.0], []
    robot = {"state": OK._replace(bits=5.0, runtime=4.0, protective=100.0)}
    monkeypatch.setattr(ur_health.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(ur_health.time, "sleep", lambda s: now.__setitem__(0, now[0] + s))

    def request(host, command):
        said.append((command, round(now[0], 6)))
        freed = {"bits": 1.0, "protective": 0.0} if "unlock" in command else {}
        ended = {"runtime": 1.0} if command == "stop" else {}
        robot["state"] = robot["state"]._replace(**freed, **ended)
        return "done"

    monkeypatch.setattr(ur_health, "request", request)
    ur_health.clear(HOST, lambda: robot["state"])
    unlocked = ("unlock protective stop", 105.1)
    assert said == [("close safety popup", 105.1), unlocked, ("stop", 105.1)]
    with pytest.raises(StoppedError, match="cannot be cleared from here: emergency stop"):
        ur_health.clear(HOST, lambda: OK._replace(bits=64.0))


@pytest.mark.parametrize(
    "answer", [b"\x00\x01V", b"\xff\xffV" * 3, b"\x00\x04V\x00", b"\x00\x04Q\x01", b"\x00", b""]
)
def test_a_controller_that_answers_nonsense_is_refused(answer):
    def serve(link):
        link.recv(5)
        link.sendall(answer)

    with server(states.PORT, serve), pytest.raises(DriverError) as caught:
        states.Outputs(HOST, ["timestamp"], 1.0)
    assert isinstance(caught.value, LinkError) == (len(answer) < 3)


def packet(kind: bytes, body: bytes) -> bytes:
    return (3 + len(body)).to_bytes(2, "big") + kind + body


SETTINGS = {
    "timestamp": (41.5,), "payload": (1.25,), "payload_cog": (0.0, 0.01, 0.05),
    "tcp_offset": (0.0, 0.0, 0.1, 0.0, 0.0, 0.5), "safety_mode": (3,), "robot_mode": (7,),
    "speed_scaling": (0.5,),
}  # fmt: skip
KINDS = {1: "DOUBLE", 3: "VECTOR3D", 6: "VECTOR6D"}


def controller(*rows, lacks: str = "", start: bytes = b"\x01"):
    """Serves packets of named values, as an old controller does that lacks one output."""

    def kind(name):
        return "INT32" if name.endswith("_mode") else KINDS[len(rows[0][name])]

    def serve(link):
        while request := link.recv(3):
            body = link.recv(int.from_bytes(request[:2], "big") - 3) if request[1] > 3 else b""
            match request[2:]:
                case b"V":
                    link.sendall(packet(b"V", b"\x01"))
                case b"v":
                    version = b"".join(n.to_bytes(4, "big") for n in (3, 4, 1, 2))
                    link.sendall(packet(b"M", b"\x01a\x01b") + packet(b"v", version))
                case b"O":
                    names = body[8:].decode().split(",")
                    kinds = [
                        "NOT_FOUND" if n in (lacks, "ft_raw_wrench") else kind(n) for n in names
                    ]
                    link.sendall(packet(b"O", b"\x01" + ",".join(kinds).encode()))
                case b"S":
                    link.sendall(packet(b"S", start))
                    for row in rows:
                        flat = b"".join(
                            struct.pack(*((">i", int(v)) if kind(n) == "INT32" else (">d", v)))
                            for n in names for v in row[n]
                        )  # fmt: skip
                        link.sendall(packet(b"M", b"\x01a\x01b\x03") + packet(b"U", b"\x01" + flat))

    return serve


def test_how_the_controller_is_set_up_is_read_by_its_own_types():
    with server(states.PORT, controller(SETTINGS)):
        assert identity.settings(HOST) == {
            "payload": 1.25, "payload_cog": [0.0, 0.01, 0.05], "time": 41.5,
            "tcp_offset": [0.0, 0.0, 0.1, 0.0, 0.0, 0.5], "safety_mode": "protective stop",
            "robot_mode": "running", "speed_scaling": 0.5,
        }  # fmt: skip


def test_an_older_controller_says_less_and_no_answer_is_no_settings():
    with server(states.PORT, controller(SETTINGS, lacks="payload_cog")):
        stated = identity.settings(HOST)
    assert "payload_cog" not in stated and (stated["payload"], stated["time"]) == (1.25, 41.5)
    with server(states.PORT, controller(SETTINGS, start=b"\x00")):
        assert identity.settings(HOST) == {}
    assert identity.settings(HOST) == {}


def sent(**change):
    """Outputs of a state of a healthy robot."""
    state = OK._replace(current=(0.0,) * 6, **change)._asdict()
    values = {name: state[field] for field, name in states._FIELDS.items() if field != "raw"}
    return {name: v if isinstance(v, tuple) else (v,) for name, v in values.items()}


def test_states_are_counted_refused_and_dated():
    rows = [sent(stamp=s) for s in (2.0, 2.0, 2.008, 2.04, 2.048, 2.032, 0.5)]
    rows[4]["safety_mode"] = (0,)
    published = []
    with server(states.PORT, controller(*rows)):
        receiver = StateReceiver(HOST, None, Snapshot(), published.append)
        end = time.monotonic() + 3.0
        while receiver.newest.back == 0.0 and time.monotonic() < end:
            time.sleep(0.002)
        receiver.close()
    state = receiver.newest
    assert [s.stamp for s in receiver.recent] == [2.0, 2.008, 2.04, 0.5]
    assert (state.received, state.skipped, state.bad) == (4.0, 3.0, 2.0)
    assert state.back == pytest.approx(1.54) and published[-1] is state and receiver.ended
    with server(states.PORT, controller(rows[0])):
        renewed = StateReceiver(HOST, None, state, published.append)
        while renewed.newest.t == 0.0 and time.monotonic() < end:
            time.sleep(0.002)
        renewed.close()
    assert renewed.newest.received == 5.0 and renewed.newest.back == 0.0


UR5 = registry.load("robots", "ur5")


def test_a_raw_wrench_is_already_in_the_sensors_axes():
    raw = OK._replace(major=5.0, raw=(1.0, 2.0, 3.0, 4.0, 5.0, 6.0))
    assert own_wrench.reading(raw, UR5).wrench == pytest.approx([1, 2, 3, 4, 5, 6])
    assert own_wrench.facts(raw, {})["frame"] == "flange"
    assert own_wrench.facts(OK, {})["reference"] == "tcp"


def test_the_own_wrench_is_a_transducer():
    now = time.monotonic() + 60.0  # whatever the test's machine does meanwhile
    came = [OK._replace(t=now - 0.6)]
    own = own_wrench.OwnWrench(UR5, lambda t: [state for state in came if state.t > t])
    with own_wrench.transducer("rtde", "", own) as wrench:
        for k in range(9):  # two at once: both are kept
            came.append(OK._replace(t=now - 0.47 + 0.05 * k))
            came.append(OK._replace(t=now - 0.45 + 0.05 * k, received=float(k)))
            assert wrench.read().fresh and not wrench.read().fresh
        assert wrench.at(now - 0.27).age == pytest.approx(0.0, abs=1e-6)
        assert wrench.at(now - 0.23).wrench.shape == (6,)
        assert wrench.at(now - 0.23).age == pytest.approx(0.01, abs=1e-6)
        assert wrench.at(now - 0.55) is None and wrench.at(now - 9.0) is None
        assert wrench.health().state == "ok"


@pytest.mark.parametrize(
    "change, error",
    [
        ({"sensor": "nonsense"}, "netft"), ({"sensor": "netft://"}, "netft"),
        ({"sensor": "netft://h?x=1"}, "netft"), ({"sensor": "ftp://h"}, "netft"),
        ({"frequency": 0.0}, "frequency"), ({"watchdog_hz": 500.0}, "watchdog_hz"),
        ({"connect_s": -1.0}, "connect_s"),
    ],
)  # fmt: skip
def test_wrong_options_are_refused(change, error):
    with pytest.raises(ParameterError, match=error):
        RtdeDriver(RtdeOptions(**change))
