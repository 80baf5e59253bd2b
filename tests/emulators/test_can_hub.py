"""The CAN hub: its text protocol, slow and silent clients, python-can, and devices that fail."""

import socket
import struct
import threading
import time
from contextlib import contextmanager

import can
import pytest

from medrue_bench import until
from robot_emulators import can_bus as text
from robot_emulators.base.faults import TimedFault
from robot_emulators.base.named_values import read
from robot_emulators.can_bus import Frame, Hub
from robot_emulators.errors import SettingError
from robot_emulators.medrue.server import BusSettings
from unstarted import emulated
from wrenchbed.errors import LinkError
from wrenchbed.hardware.drivers.can import bus
from wrenchbed.hardware.drivers.can.bus import CanLink, open_bus
from wrenchbed.plant.serving import EmulatorOptions

HOST = "127.0.4.2"


@contextmanager
def hub(**more):
    one = Hub(HOST, 0, **more)
    one.start()
    try:
        yield one
    finally:
        one.stop()


def test_frames_as_the_protocol_writes_them():
    assert text.frame_text(Frame(0x123, b"\x0a\x0b"), 12.3456) == b"< frame 123 12.345600 0a0b >"
    assert text.frame_text(Frame(0x12345, b"", True), 1.0) == b"< frame 00012345 1.000000  >"
    assert text.frame_of(("123", "2", "a", "b")) == Frame(0x123, b"\x0a\x0b")
    assert text.frame_of(("00012345", "0")) == Frame(0x12345, b"", True)


@pytest.mark.parametrize(
    "words", ["", "123", "1234 0", "800 0", "123 9", "123 1", "123 1 100", "12g 0", "FFFFFFFF 0",
              "123 -1", "-12 0"],
)  # fmt: skip
def test_words_that_are_no_frame(words):
    assert text.frame_of(tuple(words.split())) is None


@pytest.mark.wire
def test_two_clients_of_python_can_hear_each_other_and_not_themselves():
    with hub() as one:
        buses = [
            can.Bus(interface="socketcand", host=HOST, port=one.port, channel="can0", tcp_tune=True)
            for _ in range(2)
        ]
        try:
            sent = can.Message(arbitration_id=0x321, data=[1, 2, 255], is_extended_id=False)
            buses[0].send(sent)
            got = buses[1].recv(2.0)
            assert (got.arbitration_id, bytes(got.data)) == (0x321, b"\x01\x02\xff")
            buses[1].send(can.Message(arbitration_id=0x1ABCDEF, is_extended_id=True))
            got = buses[0].recv(2.0)
            assert got.is_extended_id and got.arbitration_id == 0x1ABCDEF and got.dlc == 0
            assert buses[0].recv(0.05) is None
        finally:
            for bus in buses:
                bus.shutdown()


@pytest.mark.wire
def test_the_handshake_what_is_refused_and_what_is_held_back():
    with hub() as one, socket.create_connection((HOST, one.port), 2.0) as client:
        assert client.recv(100) == b"< hi >"
        for words, answer in (
            ("< rawmode >", "< error unknown command >"),
            ("< open can7 >", "< error could not open bus >"),
            ("< open can0 >", "< ok >"),
            ("< echo >", "< error unknown command >"),
        ):
            client.sendall(words.encode())
            assert client.recv(200) == answer.encode()
        client.sendall(b"< rawmode >")
        for _ in range(20):
            one.attach()(Frame(0x123, b""))
            time.sleep(0.001)
        assert client.recv(6) == b"< ok >"
        assert client.recv(12) == b"< frame 123 "  # held back, not lost
        frames = one.counters["frames"]
        client.sendall(b"nonsense \xff\xfe < send 12 0 >< send 123 1 ff >")
        assert until(lambda: one.counters["frames"] == frames + 1)
        assert one.counters["rubbish"] >= 2


@pytest.mark.wire
def test_a_client_that_does_not_read_is_disconnected_and_the_others_are_not():
    with hub() as one:
        send = one.attach()
        slow = socket.socket()
        slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        slow.connect((HOST, one.port))
        slow.sendall(b"< open can0 >< rawmode >")
        link = open_bus("", "can0", HOST, one.port, 1_000_000)
        heard = []
        link.listen(lambda t, can_id, data: heard.append(can_id))
        try:
            begun = time.monotonic()
            while not one.counters["slow clients"] and time.monotonic() < begun + 8.0:
                for _ in range(100):
                    send(Frame(0x123, bytes(8)))
                time.sleep(0.002)
            assert one.counters["slow clients"] == 1
            assert not link.dead and heard
        finally:
            link.close()
            slow.close()


@pytest.mark.wire
def test_a_link_names_a_server_that_hangs_up_and_takes_little_time():
    with hub() as one:
        link = open_bus("", "can0", HOST, one.port, 1_000_000)
        one.order(one.hang_up)
        assert until(lambda: link.dead)
        assert "closed" in link.dead
        used = time.process_time()
        time.sleep(0.3)
        assert time.process_time() - used < 0.15  # python-can alone would spin
        with pytest.raises(LinkError, match="closed"):
            link.send(0x123, b"")
        link.close()
        link.close()


def greet(server: socket.socket) -> None:
    connection, _ = server.accept()
    connection.sendall(b"220 ready\r\n")
    connection.close()


@pytest.mark.wire
def test_a_bus_that_cannot_be_opened_is_named(monkeypatch):
    monkeypatch.setattr(bus, "OPENING_S", 0.3)
    with hub() as one, pytest.raises(LinkError, match="has no bus 'can7'"):
        open_bus("", "can7", HOST, one.port, 1_000_000)
    with socket.create_server((HOST, 0)) as silent:
        port = silent.getsockname()[1]
        with pytest.raises(LinkError, match="does not answer within"):
            open_bus("", "can0", HOST, port, 1_000_000)
    with socket.create_server((HOST, 0)) as other:
        threading.Timer(0.1, lambda: greet(other)).start()
        with pytest.raises(LinkError, match="does not speak socketcand"):
            open_bus("", "can0", HOST, other.getsockname()[1], 1_000_000)
    with pytest.raises(LinkError, match="no CAN server at"):
        open_bus("", "can0", HOST, 9, 1_000_000)
    with pytest.raises(LinkError, match="cannot open"):
        open_bus("socketcan", "no-such-bus0", "", 0, 1_000_000)


def test_a_listener_that_fails_does_not_keep_frames_from_others():
    mine = can.Bus(interface="virtual", channel="test_listener")
    other = can.Bus(interface="virtual", channel="test_listener")
    link, heard = CanLink(mine), []

    def fails(t, can_id, data):
        raise ValueError("no")

    link.listen(fails)
    link.listen(lambda t, can_id, data: heard.append((can_id, data)))
    other.send(can.Message(arbitration_id=0x5, data=b"\x01", is_extended_id=False))
    assert until(lambda: heard == [(0x5, b"\x01")])
    assert link.failures == 1 and not link.dead
    link.close()
    other.shutdown()


@pytest.mark.parametrize(
    "words, named",
    [({"nope": "1"}, "port:"), ({"base": "0x99"}, "base"), ({"nodes": "1,2,3"}, "six different"),
     ({"counts": "-1"}, "counts")],
)  # fmt: skip
def test_settings_that_are_none(words, named):
    with pytest.raises(SettingError, match=named):
        read(words, BusSettings)


@pytest.fixture(scope="module")
def idle():
    return emulated("medrue", EmulatorOptions(HOST, noise="off", setting={"port": "0"}))


@pytest.mark.parametrize("bits", [1, 0x10, 0x8000, 0xFFFF, 16.0])
def test_every_status_that_is_taken_is_sent(idle, bits):
    idle.faults.inject(TimedFault("can", "status", values={"bits": bits}))
    ((_, first), _) = idle.board._answer(1.0, 0x0, b"")
    assert struct.unpack_from(">H", first)[0] & int(bits) == int(bits)


def test_garbage_holds_nothing_that_changes_the_board(idle):
    idle.faults.inject(TimedFault("can", "garbage", values={"count": 1000}))
    ids = {frame.can_id for _, frame in idle.hub._posted}
    assert 0x680 in ids and not ids & {0x000, 0x080, 0x686, 0x68C, 0x68D, 0x68E}
    assert not any(0x200 <= can_id < 0x280 or 0x600 <= can_id < 0x680 for can_id in ids)


def raises(t, frame):
    raise ValueError(f"no {frame.can_id:X}")


def test_a_device_that_fails_is_reported_and_the_bus_goes_on():
    told, heard = [], []
    hub = Hub(HOST, 0, failed=told.append)
    hub.attach(raises)
    hub.attach(lambda t, frame: heard.append(frame.can_id))
    send = hub.attach()
    hub.start()
    try:
        for can_id in (0x123, 0x124):
            send(Frame(can_id, b""))
        hub.order(lambda: 1 / 0)
        hub.order(lambda: heard.append(0))
        assert until(lambda: sorted(heard) == [0, 0x123, 0x124])
        assert until(lambda: len(told) == 3)
        assert sorted(str(error) for error in told) == ["division by zero", "no 123", "no 124"]
        assert hub.counters["failures"] == 3
    finally:
        hub.stop()
