"""Every fault of the UR5's emulator, as a plain socket sees it."""

import itertools
import socket
import time

import pytest

import emulator_process
from ur5_socket import Client, Lines, gone

pytestmark = pytest.mark.wire

HOST = "127.0.1.31"
NAMES = "timestamp,actual_q,target_q"
TIME = 0
CYCLE = 0.008


@pytest.fixture(scope="module")
def emulator():
    with emulator_process.running(
        "ur5", HOST, "--set", "box=off", "--set", "slow_reader=1"
    ) as emulator:
        yield emulator


@pytest.fixture
def client(emulator):
    with Client(HOST) as client:
        yield client.stream(NAMES)


def silence(client: Client, longest: float) -> float:
    """How long nothing comes from now on [s]."""
    begun = time.monotonic()
    client.state(longest)
    return time.monotonic() - begun


def drain(client: Client) -> float:
    """Time stamp of the newest state that has arrived."""
    return client.newest()[TIME]


@pytest.mark.slow
def test_stall(emulator, client):
    emulator.fault("rtde", "stall", seconds=0.4)
    client.clear()
    assert 0.3 < silence(client, 1.0) < 0.6
    assert client.state()[TIME] > 0.4


def test_a_stalled_emulator_answers_later(emulator):
    emulator.fault("rtde", "stall", seconds=0.4)
    with Client(HOST) as late:
        begun = time.monotonic()
        assert late.ask("V", b"\x00\x02") == b"\x01"
        assert 0.3 < time.monotonic() - begun < 0.7


def test_freeze(emulator, client):
    emulator.fault("rtde", "freeze", seconds=0.3)
    drain(client)
    stamps = [client.state()[TIME] for _ in range(25)]
    assert len(set(stamps)) == 1
    thawed = client.until(lambda s: s[TIME] > stamps[0])
    assert thawed[TIME] - stamps[0] > 0.25


def test_drop(emulator, client):
    before = drain(client)
    emulator.fault("rtde", "drop", seconds=0.3)
    stamps = [before] + [client.state()[TIME] for _ in range(20)]
    assert max(b - a for a, b in itertools.pairwise(stamps)) == pytest.approx(0.3, abs=0.1)


def test_burst_holds_back_and_loses_nothing(emulator, client):
    emulator.fault("rtde", "burst", seconds=0.4)
    drain(client)
    first, begun = client.state()[TIME], time.monotonic()
    stamps = [first] + [client.state()[TIME] for _ in range(30)]
    assert time.monotonic() - begun < 0.15
    steps = [b - a for a, b in itertools.pairwise(stamps)]
    assert steps == pytest.approx([CYCLE] * 30)


@pytest.mark.parametrize("kind, why", [("fin", "end of file"), ("rst", "reset")])
def test_the_connection_ends(emulator, client, kind, why):
    emulator.fault("rtde", kind)
    assert gone(client) == why
    with Client(HOST) as again:
        again.stream("timestamp").state()


def test_refuse_start(emulator):
    emulator.fault("rtde", "refuse_start", seconds=0.3)
    with Client(HOST) as client:
        client.outputs("timestamp")
        assert client.ask("S") == b"\x00"
        with pytest.raises(TimeoutError):
            client.state(0.1)
        time.sleep(0.3)
        assert client.ask("S") == b"\x01"
        client.state()


def test_deaf(emulator, client):
    emulator.fault("rtde", "deaf", seconds=0.5)
    with Client(HOST) as deaf:
        deaf.send("V", b"\x00\x02")
        with pytest.raises(TimeoutError):
            deaf.packet(0.2)
        drain(client)
        client.state(0.1)
        assert deaf.packet(1.0) == ("V", b"\x01")


def test_unlisten_keeps_clients(emulator, client):
    emulator.fault("rtde", "unlisten", seconds=0.3)
    with pytest.raises(ConnectionRefusedError):
        Client(HOST)
    drain(client)
    client.state(0.1)
    time.sleep(0.4)
    Client(HOST).close()


def test_malformed_packets(emulator):
    said = {
        "empty_data": ("U", b""),
        "short_data": ("U", b"\x01" + bytes(11)),
        "unknown_type": ("?", b"what is this"),
        "short_header": ("U", b""),
    }
    for how, packet in said.items():
        with Client(HOST) as client:
            client.stream("timestamp,actual_q")
            emulator.fault("rtde", "malformed", how=how)
            normal = 1 + 7 * 8
            found = [p for p in (client.packet() for _ in range(10)) if len(p[1]) != normal]
            assert found == [packet]
    with Client(HOST) as client:
        client.stream("timestamp")
        emulator.fault("rtde", "malformed", how="garbage")
        with pytest.raises(TimeoutError):  # a size that is none
            while True:
                client.packet(0.3)
        assert bytes(range(255, 0, -7)) in client.held


def test_text_in_the_stream(emulator, client):
    emulator.fault("rtde", "text", message="mind the gap")
    assert client.answer("M") == b"\x0cmind the gap\x04twin\x02"
    client.state()


def test_not_found(emulator):
    emulator.fault("rtde", "not_found", field="actual_q", seconds=0.3)
    with Client(HOST) as client:
        assert client.outputs("timestamp,actual_q") == b"\x00DOUBLE,NOT_FOUND"
        time.sleep(0.4)
        assert client.outputs("timestamp,actual_q") == b"\x01DOUBLE,VECTOR6D"


def test_in_use(emulator):
    emulator.fault("rtde", "in_use", seconds=0.3)
    with Client(HOST) as client:
        assert client.ask("I", b"input_int_register_0") == b"\x00IN_USE"
        time.sleep(0.4)
        assert client.ask("I", b"input_int_register_0") == b"\x01INT32"


def test_inputs_are_free_again_when_their_client_is_gone(emulator):
    with Client(HOST) as first, Client(HOST) as second:
        assert first.ask("I", b"input_int_register_5") == b"\x01INT32"
        assert second.ask("I", b"input_int_register_5") == b"\x00IN_USE"
        first.close()
        time.sleep(0.05)
        assert second.ask("I", b"input_int_register_5") == b"\x01INT32"


def test_timestamp_jump(emulator, client):
    before = drain(client)
    emulator.fault("rtde", "timestamp_jump", by=-0.5)
    states = [before] + [client.state()[TIME] for _ in range(20)]
    assert min(states) == pytest.approx(before - 0.5, abs=0.1)
    assert any(b - a == pytest.approx(CYCLE - 0.5) for a, b in itertools.pairwise(states))
    emulator.fault("rtde", "timestamp_jump", by=0.5)


@pytest.mark.parametrize("kind, why", [("fin", "end of file"), ("rst", "reset")])
def test_control_faults_spare_readers(emulator, client, kind, why):
    with Client(HOST) as writer:
        writer.stream("timestamp")
        writer.ask("I", b"input_int_register_0")
        emulator.fault("control", kind)
        assert gone(writer) == why
    drain(client)
    client.state(0.1)


@pytest.mark.slow
def test_a_slow_reader_is_closed(emulator):
    with Client(HOST) as slow, Client(HOST) as quick:
        quick.stream("timestamp")
        slow.outputs(",".join(["target_moment"] * 140))
        slow.sock.sendall(b"\x00\x03S")
        time.sleep(4.0)
        quick.newest()
        assert gone(slow) in ("end of file", "reset")


def test_dashboard_faults(emulator):
    with Lines(HOST) as dashboard:
        emulator.fault("dashboard", "fin")
        assert dashboard.file.readline() == ""
    emulator.fault("dashboard", "stall", seconds=0.3)
    begun = time.monotonic()
    with Lines(HOST) as dashboard:
        assert dashboard.greeting.startswith("Connected")
        assert time.monotonic() - begun > 0.2
    emulator.fault("dashboard", "unlisten", seconds=0.2)
    with pytest.raises(ConnectionRefusedError):
        Lines(HOST)
    time.sleep(0.3)


def test_script_faults(emulator):
    with socket.create_connection((HOST, 30003), 2.0) as script:
        time.sleep(0.05)
        emulator.fault("script", "fin")
        assert script.recv(1) == b""
    emulator.fault("script", "unlisten", seconds=0.2)
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection((HOST, 30003), 2.0)


@pytest.mark.parametrize(
    "link, kind, values",
    [
        ("rtde", "malformed", {"how": "nicely"}),
        ("rtde", "not_found", {"field": "nonsense"}),
        ("rtde", "timestamp_jump", {}),
        ("robot", "follow_error", {"joints": [1.0, 0, 0, 0, 0, 0]}),
        ("robot", "dance", {}),
    ],
)
def test_impossible_faults_are_refused(emulator, link, kind, values):
    with pytest.raises(AssertionError, match="refused"):
        emulator.fault(link, kind, **values)
