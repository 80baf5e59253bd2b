"""Emulators of a UR5 and of MedRUE that all tests of drivers share, and a driver beside each."""

import pytest

import medrue_bench
import rtde_moves
from emulator_process import running


@pytest.fixture(scope="session")
def ur5():
    with running("ur5", rtde_moves.HOST, "--set", "box=off") as emulator:
        yield emulator


@pytest.fixture(scope="module")
def bench(ur5):
    """The emulated UR5, an observer, and a driver."""
    with rtde_moves.bench(ur5) as made:
        yield made


@pytest.fixture
def link(bench):
    """The driver, active and in order."""
    return bench.ready()


@pytest.fixture(scope="session")
def medrue():
    with running(
        "medrue", medrue_bench.HOST, "--set", f"slot={medrue_bench.SLOT}", "--noise", "off"
    ) as emulator:
        yield emulator


@pytest.fixture
def driver(medrue):
    """A driver of the emulated MedRUE, active and in order."""
    with medrue_bench.ready() as one:
        yield one
