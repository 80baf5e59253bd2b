"""One contract for every emulator that the registry knows; another plug-in is tested as it is."""

import re
import signal
import socket
import threading
import time
from contextlib import suppress

import pytest

from emulator_process import running
from robot_emulators.base.emulator import Emulator
from robot_emulators.errors import EmulatorError, SettingError
from wrenchbed import registry
from wrenchbed.errors import NotFoundError
from wrenchbed.plant.serving import EmulatorOptions, emulated

NAMES = registry.names("emulators")
HOST = "127.0.6.{}"
EFFECT = "sensor.gain:gain.fz=0.02"
Kind = type[Emulator]


def client_of(address: str) -> socket.socket:
    """A TCP client of an address."""
    host, port = re.search(r"(127\.[\d.]+):(\d+)", address).groups()
    return socket.create_connection((host, int(port)), 2.0)


def answers(addresses: dict[str, str]) -> list[str]:
    """The addresses at which somebody accepts a client."""
    named = [a for a in addresses.values() if re.search(r"127\.[\d.]+:\d", a)]
    assert named and len(named) == len(addresses), addresses
    open_ = []
    for address in named:
        with suppress(OSError), client_of(address):
            open_.append(address)
    return open_


def serves_at_a_loopback_address(kind: Kind, host: str) -> None:
    emulator = emulated(kind, EmulatorOptions(host, noise="off"))
    try:
        addresses = emulator.start()
        assert all(host in address for address in addresses.values())
        assert answers(addresses)
        assert not emulator.failed.wait(0.3), emulator.failure
    finally:
        emulator.stop()


def refuses_other_addresses(kind: Kind, host: str) -> None:
    for other in ("0.0.0.0", "10.0.0.1", "localhost.example", ""):
        with pytest.raises(SettingError, match=r"--host .*127\.0\.0\.1"):
            emulated(kind, EmulatorOptions(other))


def refuses_a_taken_port(kind: Kind, host: str) -> None:
    with emulated(kind, EmulatorOptions(host, noise="off")):
        other = emulated(kind, EmulatorOptions(host, noise="off"))
        with pytest.raises(EmulatorError, match=re.escape(host)):
            other.start()
        other.stop()


def stops_without_a_trace(kind: Kind, host: str) -> None:
    before = set(threading.enumerate())
    emulator = emulated(kind, EmulatorOptions(host, noise="off"))
    addresses = emulator.start()
    client = client_of(answers(addresses)[0])
    emulator.stop()
    emulator.stop()
    client.close()
    end = time.monotonic() + 3.0
    while set(threading.enumerate()) - before and time.monotonic() < end:
        time.sleep(0.01)
    assert not set(threading.enumerate()) - before
    assert not answers(addresses)


def starts_again_as_a_new_one(kind: Kind, host: str) -> None:
    for _ in range(2):
        emulator = emulated(kind, EmulatorOptions(host, noise="off"))
        try:
            assert answers(emulator.start())
        finally:
            emulator.stop()
    with pytest.raises(EmulatorError, match="make a new one"):
        emulator.start()


def refuses_settings_by_name(kind: Kind, host: str) -> None:
    with pytest.raises(SettingError, match=r"no-such.*Known: " + next(iter(kind.settings))):
        emulated(kind, EmulatorOptions(host, setting={"no-such": "1"}))
    assert all(kind.settings.values())


def refuses_faults_by_name(kind: Kind, host: str) -> None:
    faults = emulated(kind, EmulatorOptions(host, noise="off")).faults
    assert faults.known and all(link and name for link, name in faults.known)


def runs_with_an_effect(kind: Kind, host: str) -> None:
    with pytest.raises(NotFoundError, match=r"no\.such"):
        emulated(kind, EmulatorOptions(host, effects=("no.such",)))
    with emulated(kind, EmulatorOptions(host, effects=(EFFECT,))) as emulator:
        assert not emulator.failed.wait(0.5), emulator.failure


CONTRACT = (
    serves_at_a_loopback_address, refuses_other_addresses, refuses_a_taken_port,
    stops_without_a_trace, starts_again_as_a_new_one, refuses_settings_by_name,
    refuses_faults_by_name, runs_with_an_effect,
)  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("clause", CONTRACT, ids=lambda clause: clause.__name__)
def test_every_emulator(name, clause):
    clause(registry.load("emulators", name), HOST.format(1 + NAMES.index(name)))


@pytest.mark.parametrize("name", NAMES)
def test_a_process_says_ready_serves_and_ends_when_it_is_asked_to(name):
    with running(name, HOST.format(21 + NAMES.index(name)), "--noise", "off") as emulator:
        assert answers(emulator.addresses)
        emulator.process.send_signal(signal.SIGTERM)
        assert emulator.process.wait(10) == 0
    assert not answers(emulator.addresses)
