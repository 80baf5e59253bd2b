"""The hub: socketcand's text protocol, its handshake, slow and silent clients, python-can."""

import socket
import threading
import time
from contextlib import contextmanager

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_emulators.base.arguments import read
from robot_emulators.can_bus import socketcand as text
from robot_emulators.can_bus.hub import Hub
from robot_emulators.can_bus.socketcand import Frame
from robot_emulators.errors import EmulatorError, SettingError
from robot_emulators.medrue.server import BusSettings
from wrenchbed.errors import LinkError
from wrenchbed.hardware.drivers.can.bus import CanLink, open_bus

pytestmark = pytest.mark.wire

HOST = "127.0.4.2"


@contextmanager
def hub(**more):
    one = Hub(HOST, 0, **more)
    one.start()
    try:
        yield one
    finally:
        one.stop()


def until(done, seconds=3.0):
    end = time.monotonic() + seconds
    while not done() and time.monotonic() < end:
        time.sleep(0.002)
    return done()


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


@given(st.binary(max_size=600))
def test_no_bytes_break_the_reader_and_little_is_kept(raw):
    commands, rest, rubbish = text.split(raw)
    assert len(rest) <= text.LONGEST and rubbish >= 0
    for command in commands:
        text.frame_of(command.words)


@given(st.lists(st.tuples(st.integers(0, 0x7FF), st.binary(max_size=8)), max_size=8), st.data())
def test_commands_survive_being_cut_anywhere(frames, data):
    raw = b"".join(
        f"< send {i:03X} {len(d):X} {' '.join(f'{b:x}' for b in d)} >".encode() for i, d in frames
    )
    cut = data.draw(st.integers(0, len(raw)))
    first, rest, _ = text.split(raw[:cut])
    second, rest, rubbish = text.split(rest + raw[cut:])
    found = [text.frame_of(command.words) for command in first + second]
    assert found == [Frame(i, d) for i, d in frames] and rest == b"" and rubbish == 0


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


def test_the_handshake_what_is_refused_and_what_is_held_back():
    with hub() as one, socket.create_connection((HOST, one.port), 2.0) as client:
        assert client.recv(100) == b"< hi >"
        for words, answer in (
            ("< rawmode >", "< error unknown command >"),
            ("< open can7 >", "< error could not open bus >"),
            ("< open can0 >", "< ok >"),
            ("< echo >", "< echo >"),
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


def test_a_port_that_is_taken_is_named():
    with hub() as one, pytest.raises(EmulatorError, match=f"{HOST}:{one.port}.*another host"):
        Hub(HOST, one.port).start()


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


def test_a_bus_that_cannot_be_opened_is_named():
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
    bus = can.Bus(interface="virtual", channel="test_listener")
    other = can.Bus(interface="virtual", channel="test_listener")
    link, heard = CanLink(bus), []

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
     ({"watchdog": "0"}, "above 0")],
)  # fmt: skip
def test_settings_that_are_none(words, named):
    with pytest.raises(SettingError, match=named):
        read(words, BusSettings)
