"""Faults of the UR5's emulator that no driver's test sees, at a plain socket."""

import time

import pytest

from robot_emulators import FaultError, Options, TimedFault, serve
from ur5_socket import Client, Lines

pytestmark = pytest.mark.wire

HOST = "127.0.1.31"
NAMES = "timestamp,actual_q,target_q,robot_mode,safety_mode,runtime_state,safety_status_bits"
TIME, Q, TARGET = 0, slice(1, 7), slice(7, 13)
MODE, SAFETY, BITS = 13, 14, 16


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


def test_inputs_are_free_again_when_their_client_is_gone(fault):
    with Client(HOST) as first, Client(HOST) as second:
        assert first.ask("I", b"input_int_register_5") == b"\x01INT32"
        assert second.ask("I", b"input_int_register_5") == b"\x00IN_USE"
        first.close()
        time.sleep(0.05)
        assert second.ask("I", b"input_int_register_5") == b"\x01INT32"


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


def test_following_error(fault, client):
    off = [0.1, 0.0, 0.0, 0.0, 0.0, -0.05]

    def gap(state):
        return [a - b for a, b in zip(state[Q], state[TARGET], strict=True)]

    fault("robot", "follow_error", 0.4, joints=off)
    client.until(lambda s: gap(s) == pytest.approx(off, abs=2e-3))
    client.until(lambda s: gap(s) == pytest.approx([0.0] * 6, abs=1e-4))
