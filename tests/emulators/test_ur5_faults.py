"""Every fault of the UR5's emulator, as a plain socket sees it."""

import itertools
import socket
import time

import pytest

from robot_emulators import FaultError, Options, TimedFault, serve
from ur5_socket import Client, Lines, gone

pytestmark = pytest.mark.wire

HOST = "127.0.1.31"
NAMES = "timestamp,actual_q,target_q,robot_mode,safety_mode,runtime_state,safety_status_bits"
TIME, Q, TARGET = 0, slice(1, 7), slice(7, 13)
MODE, SAFETY, RUNTIME, BITS = 13, 14, 15, 16
CYCLE = 0.008
PROGRAM = b"def f():\n  while True:\n    sync()\n  end\nend\n"


@pytest.fixture(scope="module")
def fault():
    """Injects a fault into an emulator that serves as long as this module's tests run."""
    with serve("ur5", options=Options(HOST, setting={"box": "off"})) as emulator:

        def inject(link: str, kind: str, seconds: float = 0.0, **values) -> None:
            emulator.faults.inject(TimedFault(link, kind, seconds=seconds, values=values))

        yield inject


@pytest.fixture
def client(fault):
    with Client(HOST) as client:
        yield client.stream(NAMES)


@pytest.fixture
def restored(fault):
    """Leaves the emulator as it was switched on."""
    yield
    fault("robot", "restart")
    time.sleep(0.1)


def stamps(client: Client, n: int) -> list[float]:
    return [client.state()[TIME] for _ in range(n)]


def steps(times: list[float]) -> list[float]:
    return [b - a for a, b in itertools.pairwise(times)]


def refused(port: int) -> None:
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection((HOST, port), 2.0)


def start_program() -> None:
    with socket.create_connection((HOST, 30003), 2.0) as script:
        script.sendall(PROGRAM)


def test_a_stalled_emulator_is_silent_and_answers_later(fault, client):
    before = client.newest()[TIME]
    fault("rtde", "stall", 0.3)
    client.clear()
    begun = time.monotonic()
    with Client(HOST) as late:
        assert late.ask("V", b"\x00\x02") == b"\x01"
        assert 0.2 < time.monotonic() - begun < 0.6
    assert client.state()[TIME] - before > 0.2


def test_packets_freeze_are_left_out_or_come_in_a_burst(fault, client):
    fault("rtde", "freeze", 0.3)
    client.newest()
    frozen = stamps(client, 20)
    assert len(set(frozen)) == 1
    before = client.until(lambda s: s[TIME] > frozen[0])[TIME]
    assert before - frozen[0] > 0.2
    fault("rtde", "drop", 0.3)
    assert max(steps([before, *stamps(client, 20)])) == pytest.approx(0.3, abs=0.1)
    fault("rtde", "burst", 0.3)
    client.newest()
    first, begun = client.state()[TIME], time.monotonic()
    times = [first, *stamps(client, 20)]
    assert time.monotonic() - begun < 0.15
    assert steps(times) == pytest.approx([CYCLE] * 20)


@pytest.mark.parametrize("kind, why", [("fin", "end of file"), ("rst", "reset")])
def test_the_connection_ends(fault, client, kind, why):
    fault("rtde", kind)
    assert gone(client) == why
    with Client(HOST) as again, Client(HOST) as writer:
        again.stream("timestamp").state()
        writer.stream("timestamp").ask("I", b"input_int_register_0")
        fault("control", kind)  # spares who only reads
        assert gone(writer) == why
        again.newest()


def test_what_is_refused_for_a_while(fault):
    for kind, more in (("refuse_start", {}), ("in_use", {}), ("not_found", {"field": "actual_q"})):
        fault("rtde", kind, 0.3, **more)
    with Client(HOST) as client:
        assert client.outputs("timestamp,actual_q") == b"\x00DOUBLE,NOT_FOUND"
        assert client.ask("I", b"input_int_register_0") == b"\x00IN_USE"
        client.outputs("timestamp")
        assert client.ask("S") == b"\x00"
        with pytest.raises(TimeoutError):
            client.state(0.1)
        time.sleep(0.3)
        assert client.ask("I", b"input_int_register_0") == b"\x01INT32"
        assert client.outputs("timestamp,actual_q") == b"\x01DOUBLE,VECTOR6D"
        assert client.ask("S") == b"\x01"
        client.state()


def test_inputs_are_free_again_when_their_client_is_gone(fault):
    with Client(HOST) as first, Client(HOST) as second:
        assert first.ask("I", b"input_int_register_5") == b"\x01INT32"
        assert second.ask("I", b"input_int_register_5") == b"\x00IN_USE"
        first.close()
        time.sleep(0.05)
        assert second.ask("I", b"input_int_register_5") == b"\x01INT32"


def test_a_new_client_can_be_deaf_and_a_port_closed_while_others_go_on(fault, client):
    fault("rtde", "deaf", 0.3)
    with Client(HOST) as deaf:
        deaf.send("V", b"\x00\x02")
        with pytest.raises(TimeoutError):
            deaf.packet(0.1)
        client.newest()
        assert deaf.packet(1.0) == ("V", b"\x01")
    fault("rtde", "unlisten", 0.2)
    refused(30004)
    client.newest()
    time.sleep(0.25)
    Client(HOST).close()


@pytest.mark.parametrize(
    "how, packet",
    [("empty_data", ("U", b"")), ("short_data", ("U", b"\x01" + bytes(11))),
     ("unknown_type", ("?", b"what is this")), ("short_header", ("U", b""))],
)  # fmt: skip
def test_malformed_packets(fault, how, packet):
    with Client(HOST) as client:
        client.stream("timestamp,actual_q")
        fault("rtde", "malformed", how=how)
        normal = 1 + 7 * 8
        assert [p for p in (client.packet() for _ in range(10)) if len(p[1]) != normal] == [packet]


def test_garbage_and_text_in_the_stream(fault, client):
    fault("rtde", "text", message="mind the gap")
    assert client.answer("M") == b"\x0cmind the gap\x04twin\x02"
    client.state()
    fault("rtde", "malformed", how="garbage")
    with pytest.raises(TimeoutError):  # a size that is none
        while True:
            client.packet(0.3)
    assert bytes(range(255, 0, -7)) in client.held


def test_timestamp_jump(fault, client):
    before = client.newest()[TIME]
    fault("rtde", "timestamp_jump", by=-0.5)
    times = [before, *stamps(client, 20)]
    assert min(times) == pytest.approx(before - 0.5, abs=0.1)
    assert any(step == pytest.approx(CYCLE - 0.5) for step in steps(times))
    fault("rtde", "timestamp_jump", by=0.5)


def test_faults_of_dashboard_and_script(fault):
    with Lines(HOST) as dashboard, socket.create_connection((HOST, 30003), 2.0) as script:
        time.sleep(0.05)
        fault("dashboard", "fin")
        fault("script", "fin")
        assert dashboard.file.readline() == "" and script.recv(1) == b""
    fault("dashboard", "stall", 0.2)
    begun = time.monotonic()
    with Lines(HOST) as dashboard:
        assert dashboard.greeting.startswith("Connected")
        assert time.monotonic() - begun > 0.1
    for link, port in (("dashboard", 29999), ("script", 30003)):
        fault(link, "unlisten", 0.1)
        refused(port)
    time.sleep(0.15)


@pytest.mark.parametrize(
    "link, kind, values",
    [("rtde", "malformed", {"how": "nicely"}), ("rtde", "not_found", {"field": "nonsense"}),
     ("rtde", "timestamp_jump", {}), ("robot", "follow_error", {"joints": [1.0, 0, 0, 0, 0, 0]}),
     ("robot", "dance", {})],
)  # fmt: skip
def test_impossible_faults_are_refused(fault, link, kind, values):
    with pytest.raises(FaultError, match=f"{link} {kind}"):
        fault(link, kind, **values)


def test_emergency_stop(fault, client, restored):
    fault("robot", "emergency_stop", 0.2)
    state = client.until(lambda s: s[SAFETY] == 7)
    assert state[BITS] & 1 << 7 and state[MODE] == 3
    assert client.until(lambda s: s[SAFETY] == 1)[MODE] == 3
    with Lines(HOST) as dashboard:
        assert dashboard.ask("power on") == "Powering on"
        client.until(lambda s: s[MODE] == 5)
        assert dashboard.ask("brake release") == "Brake releasing"
        client.until(lambda s: s[MODE] == 7)


def test_faults_that_end_a_program_or_keep_it_from_starting(fault, client, restored):
    fault("robot", "script_never_starts", 0.2)
    start_program()
    client.newest()
    assert {client.state()[RUNTIME] for _ in range(10)} == {1}
    time.sleep(0.2)
    for kind in ("program_stop", "power_off"):
        start_program()
        client.until(lambda s: s[RUNTIME] == 2)
        fault("robot", kind)
        client.until(lambda s: s[RUNTIME] == 1)
    client.until(lambda s: s[MODE] == 3)


def test_following_error(fault, client):
    off = [0.1, 0.0, 0.0, 0.0, 0.0, -0.05]

    def gap(state):
        return [a - b for a, b in zip(state[Q], state[TARGET], strict=True)]

    fault("robot", "follow_error", 0.4, joints=off)
    client.until(lambda s: gap(s) == pytest.approx(off, abs=2e-3))
    client.until(lambda s: gap(s) == pytest.approx([0.0] * 6, abs=1e-4))


def test_restart(fault, client):
    with Lines(HOST) as dashboard:
        fault("robot", "restart", 0.2)
        assert gone(client) in ("end of file", "reset")
        assert dashboard.file.readline() == ""
    refused(30004)
    time.sleep(0.3)
    with Client(HOST) as again:
        assert again.stream(NAMES).state()[TIME] < 1.0
