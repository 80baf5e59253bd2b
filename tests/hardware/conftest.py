"""Emulators of a UR5 and of MedRUE that all tests of drivers share, and a driver beside each."""

import contextlib

import pytest

import medrue_bench
import rtde_moves
from emulator_process import shared
from wrenchbed.hardware.drivers.can import CanDriver


@pytest.fixture(scope="session")
def ur5():
    return shared("ur5", rtde_moves.HOST)


@pytest.fixture(scope="module")
def bench(ur5):
    with rtde_moves.bench(ur5) as made:
        yield made


@pytest.fixture
def link(bench):
    """The driver, active and in order."""
    return bench.ready()


@pytest.fixture(scope="session")
def medrue():
    return shared("medrue", medrue_bench.HOST, *medrue_bench.WORDS)


@pytest.fixture(scope="module")
def opened(medrue):
    """A driver of the emulated MedRUE; its tests share it, as connecting takes a second."""
    with contextlib.closing(CanDriver(medrue_bench.options())) as one:
        yield one


@pytest.fixture
def driver(opened):
    """The driver, active and in order."""
    return medrue_bench.readied(opened)


@pytest.fixture
def free(medrue, opened):
    """The emulated MedRUE, and no driver on its bus."""
    opened.close()
    return medrue
