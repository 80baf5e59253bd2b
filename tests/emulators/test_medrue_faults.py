"""Faults of MedRUE's emulator that are told wrongly, and what its bus does when a device fails."""

import socket
import struct

import pytest

from can_witness import connected
from medrue_bench import until
from robot_emulators.base.faults import TimedFault
from robot_emulators.can_bus.hub import Hub
from robot_emulators.can_bus.socketcand import Frame
from robot_emulators.errors import FaultError
from wrenchbed.plant.serving import EmulatorOptions, emulated

HOST = "127.0.4.7"


@pytest.fixture(scope="module")
def idle():
    """An emulator that was never started."""
    return emulated("medrue", EmulatorOptions(HOST, noise="off", setting={"port": "0"}))


@pytest.mark.parametrize(
    "kind, values, named",
    [("status", {"bits": 0x80000010}, "bits = 2147483664 must be a whole number 1 … 65535"),
     ("emcy", {"code": 0}, "code"), ("mute", {"node": True}, "node = True"),
     ("emcy", {"node": 7}, "node = 7 must be a node: 1, 2, 3, 4, 5, 6"),
     ("mute", {"nod": 4}, "nod"), ("saturated_gauge", {"gauge": 6}, "gauge = 6"),
     ("garbage", {"count": 1e9}, "count"), ("reset_board", {"silent": 0}, "silent = 0")],
)  # fmt: skip
def test_values_out_of_range_are_refused_by_name(idle, kind, values, named):
    with pytest.raises(FaultError, match=f"can {kind}.*{named}"):
        idle.faults.inject(TimedFault("can", kind, values=values))


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


def test_a_hub_whose_thread_ends_says_so_and_hangs_up(monkeypatch):
    told = []
    hub = Hub(HOST, 0, failed=told.append)
    hub.start()
    try:
        with connected(HOST, hub.port) as client:
            monkeypatch.setattr(hub, "_pass_on", lambda: 1 / 0)
            hub.order(lambda: None)
            client.settimeout(2.0)
            assert client.recv(100) == b""
            assert until(lambda: told) and isinstance(told[0], ZeroDivisionError)
            with pytest.raises(OSError):
                socket.create_connection((HOST, hub.port), 0.5)
    finally:
        hub.stop()


def test_an_emulator_whose_board_fails_reports_it():
    with emulated("medrue", EmulatorOptions(HOST, noise="off", setting={"port": "0"})) as emulator:
        emulator.board.status = 1 << 31
        send = emulator.hub.attach()
        send(Frame(0x680, b""))
        assert emulator.failed.wait(2.0) and isinstance(emulator.failure, struct.error)
