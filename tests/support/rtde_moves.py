"""What a driver of UR robots says and does when something goes wrong during a move."""

import contextlib
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rtde_observer import Observer
from wrenchbed.errors import DriverError
from wrenchbed.hardware.device_base import wait_until
from wrenchbed.hardware.drivers.rtde import RtdeDriver, RtdeOptions
from wrenchbed.robots.checked_moves import Limits

HOST = "127.0.2.12"
A = np.array([0.0, -1.2, -1.9, -1.6, 1.5708, 0.0])
B = A + np.array([0.6, 0.2, 0.0, 0.0, 0.0, 0.3])
NAMED_S = 0.1
"""By when a stale state must be named [s]; what dies or hangs otherwise by 1 s."""
AT_REST_S = 0.45
"""Time after which a robot that lost its client is at rest: watchdog 0.1 s, braking, a load."""


@dataclass
class Outcome:
    """What was seen after a fault: states, errors, times [s] and travel [rad].

    ``first`` is the first state that is not ok and ``named`` its time; ``state`` and ``detail`` are
    of the first that is worse than stale, which a busy machine may be for a moment.
    """

    first: str = "ok"
    named: float = np.inf
    state: str = "ok"
    detail: str = ""
    error: DriverError | None = None
    ended: float = np.inf
    late_travel: float = 0.0
    last: str = ""

    def note(self, health, t):
        """Take in a state at a time [s] after the fault."""
        if not health.ok and self.first == "ok":
            self.first, self.named = health.state, t
        if health.state not in ("ok", "stale") and self.state == "ok":
            self.state, self.detail = health.state, health.detail


def alive(pid):
    """Whether a process lives; one whose parent died may stay as a zombie."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except FileNotFoundError:
        return False
    return stat.rpartition(")")[2].split()[0] != "Z"


def driver(host=HOST, **more):
    options = {"sensor": "rtde", "limits": Limits(speed=0.3, tracking=0.5)} | more
    return RtdeDriver(RtdeOptions(host=host, **options))


@dataclass
class Bench:
    """An emulator, an observer beside the driver, and the driver."""

    emulator: object
    observer: Observer
    driver: RtdeDriver

    def ready(self):
        """The driver, active and in order."""
        if not self.driver._active or not self.driver.health().ok:
            recovered(self.driver)
        return self.driver


@contextlib.contextmanager
def bench(emulator):
    """An emulator and everything around it until the block ends."""
    with Observer(HOST) as observer, contextlib.closing(driver(power_on=True)) as link:
        link.connect()
        yield Bench(emulator, observer, link)


def disturbed(bench, disturb, rest_from=AT_REST_S):
    """Start a long move, disturb it, and watch until it ends; then whether the robot rests."""
    link = bench.driver
    motion = _under_way(link)
    disturb()
    begun, seen = time.monotonic(), Outcome()
    while time.monotonic() < begun + 6.0:
        seen.note(link.health(), time.monotonic() - begun)
        try:
            if motion.poll() is not None:
                break
        except DriverError as error:
            seen.error = error
            seen.note(link.health(), time.monotonic() - begun)
            break
        time.sleep(0.001)
    seen.ended = time.monotonic() - begun
    seen.last = link.health().state
    if seen.error is not None:
        time.sleep(max(0.0, begun + rest_from + 0.1 - time.monotonic()))
        seen.late_travel = bench.observer.travel(begun + rest_from)
    return seen


def _under_way(link):
    """A move that goes on; on a busy machine the robot's watchdog may end one or two."""
    seen = []
    for _ in range(5):
        q = link.position()
        try:
            motion = link.move(A if np.abs(A - q).max() > np.abs(B - q).max() else B)
            time.sleep(0.25)
            assert motion.poll() is None
            return motion
        except DriverError as error:
            seen.append(str(error))
            recovered(link)
    raise AssertionError(f"no move goes on undisturbed: {seen}")


def recovered(link, tries=6):
    """Recover as a campaign would; the time it took [s]."""
    begun = time.monotonic()
    for k in range(tries):
        try:
            link.recover(unlock=True)
            break
        except DriverError:
            if k == tries - 1:
                raise
            time.sleep(0.3)
    assert wait_until(lambda: link.health().ok, 2.0), link.health()
    return time.monotonic() - begun
