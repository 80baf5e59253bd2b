"""A UR robot whose controller is switched off for good, or hangs up on a client that sleeps."""

import contextlib
import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest

import rtde_moves
from emulator_process import running
from rtde_moves import A, B, recovered
from wrenchbed.errors import DriverError, LinkError
from wrenchbed.hardware.device import GONE_S

pytest.importorskip("rtde_control")
pytestmark = pytest.mark.wire
HOST, SLOW = "127.0.2.19", "127.0.2.20"


def connections(host):
    """How many clients a robot's RTDE port has."""
    at = "".join(f"{int(part):02X}" for part in reversed(host.split("."))) + ":7534"
    rows = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()]
    return sum(row[1] == at and row[3] == "01" for row in rows)


def until(condition, seconds):
    """Wait for a condition; the time it took [s]."""
    begun = time.monotonic()
    while not condition():
        assert time.monotonic() - begun < seconds, f"not within {seconds:g} s"
        time.sleep(0.002)
    return time.monotonic() - begun


@pytest.mark.slow
def test_a_controller_that_is_killed_is_lost_and_one_in_its_place_is_recovered():
    link = rtde_moves.driver(HOST)
    with contextlib.closing(link):
        with running("ur5", HOST, "--set", "box=off") as twin:
            link.connect()
            link.activate()
            motion = link.move(A if np.abs(link.position() - A).max() > 0.3 else B)
            time.sleep(0.3)
            os.kill(twin.process.pid, signal.SIGKILL)
            assert until(lambda: link.health().state == "lost", 1.5) < GONE_S + 0.3
            assert "worker" in link.health().detail
            with pytest.raises(DriverError):
                motion.wait(2.0)
            assert not link.write(link.read().q).ok
            twin.process.wait(5.0)
        begun = time.monotonic()
        with pytest.raises(LinkError, match=HOST):
            link.recover(unlock=True)
        assert time.monotonic() - begun < 12.0
        with running("ur5", HOST, "--set", "box=off"):
            assert recovered(link) < 12.0
            assert link.move(A).wait().q == pytest.approx(A, abs=1e-3)


@pytest.mark.slow
def test_a_client_that_sleeps_is_hung_up_on_and_says_so_when_it_wakes():
    more = ("--set", "box=off", "--set", "series=e", "--set", "slow_reader=1")
    with (
        running("ur5", SLOW, *more),
        contextlib.closing(rtde_moves.driver(SLOW, frequency=None)) as link,
    ):
        link.connect()
        worker = link._links._state.pid
        os.kill(worker, signal.SIGSTOP)
        assert until(lambda: link.health().state == "stale", 1.0) < rtde_moves.NAMED_S + 0.05
        until(lambda: link.health().state == "lost", GONE_S + 0.3)
        assert "state worker hangs" in link.health().detail
        assert connections(SLOW) == 1
        until(lambda: connections(SLOW) == 0, 30.0)
        os.kill(worker, signal.SIGCONT)
        until(lambda: "state worker ended" in link.health().detail, 1.0)
        assert link.health().state == "lost"
        assert recovered(link) < 6.0
