"""Faults of the UR5 emulator's robot itself, as a plain socket sees them."""

import socket
import time

import pytest

import emulator_process
from ur5_socket import Client, Lines, gone
from wrenchbed.plant.serving import EmulatorOptions, emulated

pytestmark = pytest.mark.wire

HOST = "127.0.1.37"
NAMES = "timestamp,actual_q,target_q,robot_mode,safety_mode,runtime_state,safety_status_bits"
TIME, Q, TARGET = 0, slice(1, 7), slice(7, 13)
MODE, SAFETY, RUNTIME, BITS = 13, 14, 15, 16


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


@pytest.mark.slow
def test_protective_stop(emulator, client, restored):
    emulator.fault("robot", "protective_stop")
    state = client.until(lambda s: s[SAFETY] == 3)
    assert state[BITS] & 1 << 2
    with Lines(HOST) as dashboard:
        assert dashboard.ask("safetymode") == "Safetymode: PROTECTIVE_STOP"
        assert dashboard.ask("unlock protective stop").startswith("Cannot unlock")


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


def play(host: str) -> None:
    with socket.create_connection((host, 30003), 2.0) as script:
        script.sendall(b"def endless():\n  while True:\n    sync()\n  end\nend\n")


def test_program_stop(emulator, client, restored):
    play(HOST)
    client.until(lambda s: s[RUNTIME] == 2)
    emulator.fault("robot", "program_stop")
    client.until(lambda s: s[RUNTIME] == 1)


def test_power_off(emulator, client, restored):
    play(HOST)
    emulator.fault("robot", "power_off")
    state = client.until(lambda s: s[MODE] == 3)
    assert state[RUNTIME] == 1


def test_script_never_starts(emulator, client):
    emulator.fault("robot", "script_never_starts", seconds=0.4)
    with socket.create_connection((HOST, 30003), 2.0) as script:
        script.sendall(b"def f():\n  sync()\nend\n")
        client.newest()
        assert {client.state()[RUNTIME] for _ in range(20)} == {1}
        time.sleep(0.4)
        script.sendall(b"def f():\n  sync()\nend\n")
        client.until(lambda s: s[RUNTIME] == 2)
        client.until(lambda s: s[RUNTIME] == 1)


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
    with pytest.raises(ConnectionRefusedError):
        Client(HOST)
    time.sleep(0.4)
    with Client(HOST) as again:
        assert again.stream(NAMES).state()[TIME] < 1.0


def test_a_stop_before_the_first_cycle_lasts_as_long_as_any(monkeypatch):
    emulator = emulated("ur5", EmulatorOptions("127.0.1.38", noise="off", setting={"box": "off"}))
    monkeypatch.setattr(emulator, "_wait", lambda: None)
    with emulator:
        emulator.controller.protective_stop()
        modes = emulator.controller.modes
        assert not modes.unlock()
        modes.tick(time.monotonic() + 5.1)
        assert modes.unlock()
