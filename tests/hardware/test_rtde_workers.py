"""Workers of the driver of UR robots that die or hang, and a client that takes the robot."""

import contextlib
import os
import signal
import subprocess
import sys

import pytest

import rtde_moves
from rtde_moves import NAMED_S, disturbed, recovered
from wrenchbed.errors import DriverError

pytest.importorskip("rtde_control")
pytestmark = pytest.mark.wire
HOST = "127.0.2.16"


@pytest.mark.sampled
@pytest.mark.parametrize(
    "which, how, states",
    [
        ("control", "SIGKILL", ("lost",)),
        ("control", "SIGSEGV", ("lost",)),
        ("control", "SIGSTOP", ("stopped", "lost")),
        ("state", "SIGKILL", ("lost",)),
        ("state", "SIGSEGV", ("lost",)),
        ("state", "SIGSTOP", ("lost",)),
    ],
)
def test_a_worker_that_dies_or_hangs_is_named(bench, link, which, how, states):
    worker = link._control if which == "control" else link._links._state
    hang = how == "SIGSTOP"
    seen = disturbed(
        bench, lambda: os.kill(worker.pid, getattr(signal, how)),
        rest_from=1.6 if hang and which == "state" else 0.5,
    )  # fmt: skip
    assert seen.state in states, seen.detail
    assert seen.named <= (NAMED_S if hang and which == "state" else 1.0)
    if not hang:
        assert f"{which} worker died by signal" in seen.detail and how in seen.detail
    assert isinstance(seen.error, DriverError) and seen.ended < 2.5, seen.ended
    assert seen.late_travel < 1e-3
    assert recovered(link) < 6.0
    assert not rtde_moves.alive(worker.pid)


def test_recovering_is_limited(bench):
    bench.driver.deactivate()
    driver = rtde_moves.driver(HOST, recoveries=1)
    with contextlib.closing(driver):
        driver.connect()
        driver.recover(unlock=True)
        with pytest.raises(DriverError, match="look for the cause"):
            driver.recover(unlock=True)


OTHER_CLIENT = """
import os, sys
from rtde_control import RTDEControlInterface as Control
Control(sys.argv[1], -1.0, Control.FLAG_UPLOAD_SCRIPT | Control.FLAG_UPPER_RANGE_REGISTERS
        | Control.FLAG_NO_EXT_FT)
print("in control", flush=True)
sys.stdin.read()
os._exit(0)
"""


@pytest.mark.slow
def test_a_program_of_another_client_is_noticed(bench, link):
    """It takes other registers, ends our program and plays its own."""
    other = subprocess.Popen(
        [sys.executable, "-c", OTHER_CLIENT, HOST],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
    )  # fmt: skip
    with other:
        assert any("in control" in line for line in other.stdout)
        health = link.health()
        assert health.state == "stopped" and "program" in health.detail
        assert link.read().program == "playing"
        other.stdin.close()
