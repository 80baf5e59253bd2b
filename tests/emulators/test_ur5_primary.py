"""The primary and realtime interfaces' bytes, read by offsets of the maker's table; commands."""

import socket
import struct
import time
from types import SimpleNamespace

import numpy as np
import pytest

from robot_emulators import Options, serve
from robot_emulators.ur.modes import RobotMode, Runtime, SafetyMode
from robot_emulators.ur.outputs import Outputs
from robot_emulators.ur.primary import Primary
from robot_emulators.ur.realtime import Realtime, size
from ur5_bench import CYCLE, Bench

SIZES = {0: 47, 1: 251, 2: 37, 3: 75, 4: 101, 5: 225, 6: 445, 7: 61, 8: 9, 9: 53, 10: 43, 12: 8}
"""Bytes of each part of a captured message."""


class Listener:
    """A client of the primary interface in this process, or of the realtime one."""

    def __init__(self, series: str = "cb3", kind: type = Primary) -> None:
        self.bench = Bench(series=series)
        self.outputs = Outputs(self.bench.controller, shared=False)
        self.interface = kind(self.bench.controller, SimpleNamespace(now=lambda: 12.5))
        self.heard: list[bytes] = []
        self.closed = False
        self.primary = kind is Primary
        self.talk = (self.interface.primary if self.primary else self.interface.answer)(self)

    def send(self, data: bytes, most: int = 0) -> None:
        self.heard.append(data)

    send_or_skip = send

    def run(self, seconds: float) -> list[bytes]:
        """What is heard in some time, message by message."""
        for _ in range(round(seconds / CYCLE)):
            self.bench.run(CYCLE)
            self.outputs.update(12.5, set(self.interface.wanted))
            self.interface.cycle(*([self.bench.now] if self.primary else []))
        data, found = b"".join(self.heard), []
        self.heard.clear()
        while data:
            size = struct.unpack_from(">i", data)[0]
            found.append(data[:size])
            data = data[size:]
        return found

    def ask(self, text: str) -> None:
        assert self.talk.receive(text.encode(), self.bench.now)


def parts(message: bytes) -> dict[int, bytes]:
    """Kind → bytes of each part of a robot state, with its head."""
    assert message[4] == 16 and struct.unpack_from(">i", message)[0] == len(message)
    found, at = {}, 5
    while at < len(message):
        size, kind = struct.unpack_from(">IB", message, at)
        found[kind] = message[at : at + size]
        at += size
    return found


@pytest.fixture(scope="module", params=["cb3", "e", "x"])
def listener(request):
    return Listener(request.param)


def states(messages: list[bytes]) -> list[bytes]:
    return [m for m in messages if m[4] == 16]


def kinds(messages: list[bytes]) -> list[int]:
    return [m[14] for m in messages if m[4] == 20]


def test_the_first_message_is_the_version(listener):
    first = Listener(listener.bench.controller.settings.series).run(CYCLE)[0]
    assert first[4] == 20 and first[14] == 3
    assert struct.unpack_from(">Q", first, 5)[0] == 12_500_000
    assert first[15] == 9 and first[16:25] == b"URControl"
    major, minor, bugfix, build = struct.unpack_from(">BBii", first, 25)
    assert (major, minor, bugfix, build) == listener.bench.controller.settings.version
    assert b"20" in first[35:]


def test_the_robot_state_comes_ten_times_a_second_with_all_its_parts(listener):
    listener.run(0.2)
    found = states(listener.run(2.0))
    assert 19 <= len(found) <= 21
    sizes = {kind: len(part) for kind, part in parts(found[-1]).items()}
    series = listener.bench.controller.settings.series
    assert sizes == SIZES | ({} if series == "cb3" else {11: 26})


def test_parts_hold_what_they_should(listener):
    listener.run(0.3)
    found = parts(states(listener.run(0.3))[-1])
    arm = listener.bench.arm
    mode = found[0]
    assert struct.unpack_from(">Q", mode, 5)[0] == 12_500_000
    assert list(mode[13:22]) == [1, 1, 1, 0, 0, 0, 0, 7, 0]
    assert struct.unpack_from(">3d", mode, 22) == (1.0, 1.0, 1.0)
    for k in range(6):
        q, target, _ = struct.unpack_from(">3d", found[1], 5 + 41 * k)
        assert abs(q - arm.plant.q[k]) < 0.02 and target == pytest.approx(arm.q[k])
        assert found[1][5 + 41 * k + 40] == 253
    pose = struct.unpack_from(">6d", found[4], 5)
    assert np.allclose(pose[:3], arm.kinematics.pose(arm.plant.q, arm.tcp)[:3])
    a = struct.unpack_from(">6d", found[5], 5 + 24 + 48)
    d = struct.unpack_from(">6d", found[5], 5 + 24 + 96)
    alpha = struct.unpack_from(">6d", found[5], 5 + 24 + 144)
    assert a == (0.0, -0.425, -0.39225, 0.0, 0.0, 0.0)
    assert d == (0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823)
    assert np.allclose(alpha, np.array([1, 0, 0, 1, -1, 0]) * np.pi / 2)
    limits = arm.kinematics.lower[0], arm.kinematics.upper[0]
    assert struct.unpack_from(">2d", found[6], 5) == limits
    assert struct.unpack_from(">4d", found[6], 5 + 192) == (1.05, 1.4, 0.25, 1.2)
    assert struct.unpack_from(">6d", found[6], 5 + 232) == a
    assert struct.unpack_from(">i", found[6], 445 - 8)[0] == 1
    assert found[3][5 + 60] == 1


def test_commands_of_the_pendant(listener):
    modes = listener.bench.controller.modes
    for text, mode in (("power off", RobotMode.POWER_OFF), ("power on", RobotMode.IDLE),
                       ("set robotmode run", RobotMode.RUNNING)):  # fmt: skip
        listener.ask(text + "\n")
        messages = listener.run(1.2)
        assert modes.robot is mode
        assert parts(states(messages)[-1])[0][20] == int(mode)


def test_a_protective_stop_is_in_the_state_before_its_code_comes(listener):
    listener.run(0.3)
    listener.ask("def stopping():\n  protective_stop()\n  sync()\nend\n")
    messages = listener.run(0.3)
    order = [m[14] if m[4] == 20 else 16 for m in messages]
    code = next(m for m in messages if m[4] == 20 and m[14] == 6)
    assert struct.unpack_from(">iii", code, 15) == (209, 0, 2)
    assert order.index(5) < order.index(6)
    stopped = [m for m in messages[: order.index(6)] if m[4] == 16][-1]
    assert parts(stopped)[0][17] == 1 and parts(stopped)[3][5 + 60] == 3
    listener.ask("set unlock protective stop\n")
    messages = listener.run(0.5)
    assert listener.bench.controller.modes.safety is SafetyMode.NORMAL
    assert parts(states(messages)[-1])[0][17] == 0
    listener.ask("stop program\n")
    listener.run(0.1)
    assert listener.bench.controller.modes.runtime is Runtime.STOPPED


def test_a_program_says_when_it_begins_speaks_and_ends(listener):
    listener.run(0.2)
    listener.ask('def f():\n  textmsg("it is ", [1, 2.5])\n  popup("look", title="T")\nend\n')
    told = [m for m in listener.run(0.1) if m[4] == 20]
    assert kinds(told) == [7, 0, 2, 7]
    assert told[0][24:] == b"PROGRAM_XXX_STARTEDf" and told[0][23] == 19
    assert told[1][15:] == b"it is [1, 2.5]"
    assert told[2].endswith(b"\x01Tlook")
    assert told[3][24:] == b"PROGRAM_XXX_STOPPEDf"


def test_a_runtime_exception_has_line_and_column(listener):
    listener.run(0.2)
    listener.ask("def wrong():\n  nowhere()\nend\n")
    (told,) = [m for m in listener.run(0.1) if m[4] == 20]
    assert told[14] == 10 and struct.unpack_from(">II", told, 15) == (2, 3)
    assert told[23:] == b"compile_error_name_not_found:nowhere:"
    assert listener.bench.controller.modes.runtime is Runtime.STOPPED


@pytest.mark.wire
def test_a_program_sent_to_the_primary_port_calls_back():
    host = "127.0.1.35"
    with (
        serve("ur5", options=Options(host, setting={"box": "off"})) as emulator,
        socket.create_server(("127.0.0.1", 0)) as server,
        socket.create_connection((host, 30001), 2.0) as client,
    ):
        assert emulator.addresses["primary"] == f"{host}:30001"
        port = server.getsockname()[1]
        client.sendall(
            f'def f():\n  socket_open("127.0.0.1", {port})\n  socket_send_int(7)\n'
            "  x = socket_read_binary_integer(1)\n  textmsg(x[1])\nend\n".encode()
        )
        server.settimeout(2.0)
        peer, address = server.accept()
        with peer:
            peer.settimeout(2.0)
            assert address[0] == host and peer.recv(4) == struct.pack(">i", 7)
            peer.sendall(struct.pack(">i", -3))
            heard, end = b"", time.monotonic() + 3.0
            while b"PROGRAM_XXX_STOPPEDf" not in heard and time.monotonic() < end:
                heard += client.recv(65536)
    assert b"PROGRAM_XXX_STARTEDf" in heard and b"-3" in heard


@pytest.mark.parametrize(
    ("version", "bytes_"),
    [((3, 3), 1060), ((3, 9), 1108), ((3, 13), 1116), ((3, 14), 1140), ((3, 15), 1220),
     ((5, 3), 1108), ((5, 8), 1116), ((5, 9), 1140), ((5, 11), 1220), ((10, 10), 1220)],
)  # fmt: skip
def test_sizes_of_messages_by_software(version, bytes_):
    assert size((*version, 0, 0)) == bytes_


def test_every_cycle_has_a_message_with_joints_and_tool():
    client = Listener(kind=Realtime)
    client.ask("movej([0,-1.2,1.2,-1.5,-1.5,0.3], a=1.4, v=1.0)\n")
    messages = client.run(0.8)
    assert len(messages) == round(0.8 / CYCLE)
    arm, last = client.bench.arm, messages[-1]
    assert struct.unpack_from(">i", last)[0] == len(last) == 1220
    assert struct.unpack_from(">d", last, 4)[0] == 12.5
    assert np.allclose(struct.unpack_from(">6d", last, 12), arm.q)
    assert np.allclose(struct.unpack_from(">6d", last, 252), arm.plant.q, atol=1e-9)
    assert np.allclose(struct.unpack_from(">6d", last, 300), arm.plant.qd, atol=1e-9)
    pose = arm.kinematics.pose(arm.plant.q, arm.tcp)
    assert np.allclose(struct.unpack_from(">6d", last, 444), pose)
    assert struct.unpack_from(">d", last, 756) == (7.0,)  # running
    assert struct.unpack_from(">d", last, 812) == (1.0,)  # normal
    assert struct.unpack_from(">d", last, 1108)[0] == 1.0  # safety status, behind the elbow
    first = struct.unpack_from(">6d", messages[0], 252)
    assert np.abs(np.array(first) - arm.plant.q).max() > 0.05


def test_who_is_gone_gets_nothing_and_costs_nothing():
    client = Listener(kind=Realtime)
    client.closed = True
    assert client.run(0.1) == [] and client.interface.wanted == frozenset()
