"""Every fault of the UR5's emulator, as a plain socket sees it."""

import itertools
import socket
import time

import pytest

import emulator_process
from ur5_socket import Client, Lines, gone

pytestmark = pytest.mark.wire

HOST = "127.0.1.31"
NAMES = "timestamp,actual_q,target_q,robot_mode,safety_mode,runtime_state,safety_status_bits"
TIME, Q, TARGET = 0, slice(1, 7), slice(7, 13)
MODE, SAFETY, RUNTIME, BITS = 13, 14, 15, 16
CYCLE = 0.008
PROGRAM = b"def f():\n  while True:\n    sync()\n  end\nend\n"


@pytest.fixture(scope="module")
def emulator():
    with emulator_process.running("ur5", HOST, "--set", "box=off") as emulator:
        yield emulator


@pytest.fixture
def client(emulator):
    with Client(HOST) as client:
        yield client.stream(NAMES)


@pytest.fixture
def restored(emulator):
    """Leaves the emulator as it was switched on."""
    yield
    emulator.fault("robot", "restart")
    time.sleep(0.1)


def stamps(client: Client, n: int) -> list[float]:
    return [client.state()[TIME] for _ in range(n)]


def steps(times: list[float]) -> list[float]:
    return [b - a for a, b in itertools.pairwise(times)]


def refused(port: int) -> None:
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection((HOST, port), 2.0)


def test_a_stalled_emulator_is_silent_and_answers_later(emulator, client):
    before = client.newest()[TIME]
    emulator.fault("rtde", "stall", seconds=0.4)
    client.clear()
    begun = time.monotonic()
    with Client(HOST) as late:
        assert late.ask("V", b"\x00\x02") == b"\x01"
        assert 0.3 < time.monotonic() - begun < 0.7
    assert client.state()[TIME] - before > 0.3


def test_freeze(emulator, client):
    emulator.fault("rtde", "freeze", seconds=0.3)
    client.newest()
    frozen = stamps(client, 25)
    assert len(set(frozen)) == 1
    assert client.until(lambda s: s[TIME] > frozen[0])[TIME] - frozen[0] > 0.25


def test_drop(emulator, client):
    before = client.newest()[TIME]
    emulator.fault("rtde", "drop", seconds=0.3)
    assert max(steps([before, *stamps(client, 20)])) == pytest.approx(0.3, abs=0.1)


def test_burst_holds_back_and_loses_nothing(emulator, client):
    emulator.fault("rtde", "burst", seconds=0.4)
    client.newest()
    first, begun = client.state()[TIME], time.monotonic()
    times = [first, *stamps(client, 30)]
    assert time.monotonic() - begun < 0.15
    assert steps(times) == pytest.approx([CYCLE] * 30)


@pytest.mark.parametrize("kind, why", [("fin", "end of file"), ("rst", "reset")])
def test_the_connection_ends(emulator, client, kind, why):
    emulator.fault("rtde", kind)
    assert gone(client) == why
    with Client(HOST) as again, Client(HOST) as writer:
        again.stream("timestamp").state()
        writer.stream("timestamp").ask("I", b"input_int_register_0")
        emulator.fault("control", kind)  # spares who only reads
        assert gone(writer) == why
        again.newest()


def test_what_is_refused_for_a_while(emulator):
    for kind, more in (("refuse_start", {}), ("in_use", {}), ("not_found", {"field": "actual_q"})):
        emulator.fault("rtde", kind, seconds=0.4, **more)
    with Client(HOST) as client:
        assert client.outputs("timestamp,actual_q") == b"\x00DOUBLE,NOT_FOUND"
        assert client.ask("I", b"input_int_register_0") == b"\x00IN_USE"
        client.outputs("timestamp")
        assert client.ask("S") == b"\x00"
        with pytest.raises(TimeoutError):
            client.state(0.1)
        time.sleep(0.4)
        assert client.ask("I", b"input_int_register_0") == b"\x01INT32"
        assert client.outputs("timestamp,actual_q") == b"\x01DOUBLE,VECTOR6D"
        assert client.ask("S") == b"\x01"
        client.state()


def test_inputs_are_free_again_when_their_client_is_gone(emulator):
    with Client(HOST) as first, Client(HOST) as second:
        assert first.ask("I", b"input_int_register_5") == b"\x01INT32"
        assert second.ask("I", b"input_int_register_5") == b"\x00IN_USE"
        first.close()
        time.sleep(0.05)
        assert second.ask("I", b"input_int_register_5") == b"\x01INT32"


def test_a_new_client_can_be_deaf_and_a_port_closed_while_others_go_on(emulator, client):
    emulator.fault("rtde", "deaf", seconds=0.5)
    with Client(HOST) as deaf:
        deaf.send("V", b"\x00\x02")
        with pytest.raises(TimeoutError):
            deaf.packet(0.2)
        client.newest()
        assert deaf.packet(1.0) == ("V", b"\x01")
    emulator.fault("rtde", "unlisten", seconds=0.3)
    refused(30004)
    client.newest()
    time.sleep(0.4)
    Client(HOST).close()


@pytest.mark.parametrize(
    "how, packet",
    [("empty_data", ("U", b"")), ("short_data", ("U", b"\x01" + bytes(11))),
     ("unknown_type", ("?", b"what is this")), ("short_header", ("U", b""))],
)  # fmt: skip
def test_malformed_packets(emulator, how, packet):
    with Client(HOST) as client:
        client.stream("timestamp,actual_q")
        emulator.fault("rtde", "malformed", how=how)
        normal = 1 + 7 * 8
        assert [p for p in (client.packet() for _ in range(10)) if len(p[1]) != normal] == [packet]


def test_garbage_and_text_in_the_stream(emulator, client):
    emulator.fault("rtde", "text", message="mind the gap")
    assert client.answer("M") == b"\x0cmind the gap\x04twin\x02"
    client.state()
    emulator.fault("rtde", "malformed", how="garbage")
    with pytest.raises(TimeoutError):  # a size that is none
        while True:
            client.packet(0.3)
    assert bytes(range(255, 0, -7)) in client.held


def test_timestamp_jump(emulator, client):
    before = client.newest()[TIME]
    emulator.fault("rtde", "timestamp_jump", by=-0.5)
    times = [before, *stamps(client, 20)]
    assert min(times) == pytest.approx(before - 0.5, abs=0.1)
    assert any(step == pytest.approx(CYCLE - 0.5) for step in steps(times))
    emulator.fault("rtde", "timestamp_jump", by=0.5)


def test_faults_of_dashboard_and_script(emulator):
    with Lines(HOST) as dashboard, socket.create_connection((HOST, 30003), 2.0) as script:
        time.sleep(0.05)
        emulator.fault("dashboard", "fin")
        emulator.fault("script", "fin")
        assert dashboard.file.readline() == "" and script.recv(1) == b""
    emulator.fault("dashboard", "stall", seconds=0.3)
    begun = time.monotonic()
    with Lines(HOST) as dashboard:
        assert dashboard.greeting.startswith("Connected")
        assert time.monotonic() - begun > 0.2
    for link, port in (("dashboard", 29999), ("script", 30003)):
        emulator.fault(link, "unlisten", seconds=0.2)
        refused(port)
    time.sleep(0.3)


@pytest.mark.parametrize(
    "link, kind, values",
    [("rtde", "malformed", {"how": "nicely"}), ("rtde", "not_found", {"field": "nonsense"}),
     ("rtde", "timestamp_jump", {}), ("robot", "follow_error", {"joints": [1.0, 0, 0, 0, 0, 0]}),
     ("robot", "dance", {})],
)  # fmt: skip
def test_impossible_faults_are_refused(emulator, link, kind, values):
    with pytest.raises(AssertionError, match="refused"):
        emulator.fault(link, kind, **values)


def test_emergency_stop(emulator, client, restored):
    emulator.fault("robot", "emergency_stop", seconds=0.3)
    state = client.until(lambda s: s[SAFETY] == 7)
    assert state[BITS] & 1 << 7 and state[MODE] == 3
    assert client.until(lambda s: s[SAFETY] == 1)[MODE] == 3
    with Lines(HOST) as dashboard:
        assert dashboard.ask("power on") == "Powering on"
        client.until(lambda s: s[MODE] == 5)
        assert dashboard.ask("brake release") == "Brake releasing"
        client.until(lambda s: s[MODE] == 7)


def test_faults_that_end_a_program(emulator, client, restored):
    for kind in ("program_stop", "power_off"):
        with socket.create_connection((HOST, 30003), 2.0) as script:
            script.sendall(PROGRAM)
        client.until(lambda s: s[RUNTIME] == 2)
        emulator.fault("robot", kind)
        client.until(lambda s: s[RUNTIME] == 1)
    client.until(lambda s: s[MODE] == 3)


def test_script_never_starts(emulator, client, restored):
    emulator.fault("robot", "script_never_starts", seconds=0.4)
    with socket.create_connection((HOST, 30003), 2.0) as script:
        script.sendall(PROGRAM)
        client.newest()
        assert {client.state()[RUNTIME] for _ in range(20)} == {1}
        time.sleep(0.4)
        script.sendall(PROGRAM)
        client.until(lambda s: s[RUNTIME] == 2)


def test_following_error(emulator, client):
    off = [0.1, 0.0, 0.0, 0.0, 0.0, -0.05]
    emulator.fault("robot", "follow_error", joints=off, seconds=0.6)
    time.sleep(0.4)
    state = client.newest()
    gap = [a - b for a, b in zip(state[Q], state[TARGET], strict=True)]
    assert gap == pytest.approx(off, abs=2e-3)
    time.sleep(0.6)
    state = client.newest()
    assert state[Q] == pytest.approx(state[TARGET], abs=1e-4)


def test_restart(emulator, client):
    with Lines(HOST) as dashboard:
        emulator.fault("robot", "restart", seconds=0.3)
        assert gone(client) in ("end of file", "reset")
        assert dashboard.file.readline() == ""
    refused(30004)
    time.sleep(0.4)
    with Client(HOST) as again:
        assert again.stream(NAMES).state()[TIME] < 1.0
