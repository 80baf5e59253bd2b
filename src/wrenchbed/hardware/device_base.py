"""Lifecycle, health and clock of a connected device: a robot's driver or a sensor's electronics.
`STALE_S`, `GONE_S` and the states of `Health` decide when robots stop: run scripts/reactions."""

import errno
import math
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from ipaddress import ip_address
from socket import create_connection, gethostbyname, socket
from typing import ClassVar, Literal, Self

import numpy as np

from wrenchbed.errors import DriverError

State = Literal["closed", "starting", "ok", "stale", "lost", "stopped", "fault"]
"""``stale``: no fresh reading for `STALE_S`; ``lost``: the link or its worker is gone;
``stopped``: the device is at rest by a stop of its own (protective, emergency, program ended);
``fault``: the device answers and reports an error that a person must clear."""

STALE_S = 0.08
"""Age of the newest reading from which a link is stale [s]: ten states of a 125 Hz controller."""
GONE_S = 1.0
"""Age of the newest reading from which a link is lost [s]: longer than a network usually stalls."""
SPAN_S, LEAST_S = 5.0, 2.0
"""Longest and shortest time span of which a clock's drift is fitted [s]: 1 ms of 2 s is 500 ppm."""
_FEW = 4
"""Fewest points of a clock's drift fit; with fewer, only the offset of the clocks is computed."""


@dataclass(frozen=True)
class Health:
    """Health of a device: its state (`State`: ``ok``, ``stale``, ``lost``, ``stopped`` …), a
    sentence on what is wrong (empty if all is well), and name → counter of readings, losses,
    restarts."""

    state: State
    detail: str = ""
    counters: Mapping[str, float] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """Whether the device is healthy, so that it may be used."""
        return self.state == "ok"


def by_age(age: float, what: str, counters: Mapping[str, float]) -> Health:
    """Health (ok, stale, lost) of the link called ``what`` by the age [s] of its newest reading;
    ``counters`` are passed on."""
    if age < STALE_S:
        return Health("ok", "", counters)
    state: State = "stale" if age < GONE_S else "lost"
    return Health(state, f"{what}: no fresh reading for {age:.2f} s", counters)


def wait_until(done: Callable[[], bool], seconds: float, pause: float = 0.005) -> bool:
    """Poll ``done`` every ``pause`` [s]; return True once it holds, False after ``seconds``."""
    end = time.monotonic() + seconds
    while not done():
        if time.monotonic() > end:
            return False
        time.sleep(pause)
    return True


def only_here(host: str) -> bool:
    """Whether ``host`` is a loopback address of this machine, where only emulators serve."""
    try:
        return ip_address(gethostbyname(host)).is_loopback
    except (OSError, UnicodeError, ValueError):
        return False


def connected(host: str, port: int, timeout: float) -> socket:
    """Open a TCP connection to a host within ``timeout`` [s] and return it. Raises an `OSError` if
    that fails, also where ``host`` is no valid name of a host."""
    try:
        return create_connection((host, port), timeout)
    except UnicodeError as error:
        raise OSError(errno.EINVAL, f"{host[:60]!r} is no name of a host") from error


class ClockFit:
    """Fits a line from a device's clock to this machine's clock, through the least delayed
    readings. Delays make readings late and never early, so only the least late reading of each
    ``stretch`` of time [s] counts; it must be so long that one of its readings arrives nearly
    without delay."""

    def __init__(self, stretch: float) -> None:
        self._stretch = stretch
        self._marks: deque[tuple[float, float]] = deque(maxlen=max(_FEW, round(SPAN_S / stretch)))
        self.clear()

    def clear(self) -> None:
        """Forget all readings, because the device's clock was set or restarted."""
        self._marks.clear()
        self._best: tuple[float, float] | None = None
        self._ends = -math.inf
        self._from = self._slope = 0.0
        self._offset = math.inf

    def add(self, device: float, host: float) -> None:
        """Add a reading: its time on the device's clock [s] and its arrival on this machine's
        [s]."""
        late = host - device
        if self._best is None or late < self._best[1]:
            self._best = (device, late)
        if len(self._marks) < _FEW:
            self._offset = min(self._offset, late)
        if device >= self._ends:
            self._marks.append(self._best)
            self._best, self._ends = None, device + self._stretch
            if len(self._marks) >= _FEW:
                marks = np.array(self._marks)
                self._from = float(marks[0, 0])
                line = np.polyfit(marks[:, 0] - self._from, marks[:, 1], 1)
                self._slope, self._offset = float(line[0]), float(line[1])

    def host(self, device: float) -> float:
        """Convert a time on the device's clock [s] to this machine's clock [s]: the arrival of a
        reading of that time that has no delay."""
        return device + self._offset + self._slope * (device - self._from)

    @property
    def ppm(self) -> float | None:
        """Drift of the device's clock against this machine's [1e-6]; None before `LEAST_S` [s]."""
        long = len(self._marks) >= _FEW and self._marks[-1][0] - self._marks[0][0] >= LEAST_S
        return -1e6 * self._slope if long else None


class Device:
    """Base class of drivers and transducers: hardware that is connected, used and closed. ``name``
    is its name in commands, ``title`` one line on what it is."""

    name: ClassVar[str]
    title: ClassVar[str]
    options: ClassVar[type]
    """Dataclass of the constructor's options."""

    def __init__(self) -> None:
        self._connected = False

    def connect(self) -> None:
        """Open the device and wait for its first reading; nothing moves. Raises a `LinkError` if it
        cannot be reached or does not answer in time, a `DriverError` if its answer is unusable."""
        if not self._connected:
            try:
                self._connect()
            except BaseException:
                self._close()
                raise
            self._connected = True

    def close(self) -> None:
        """Release the device and its connections; may be called twice."""
        if self._connected:
            self._connected = False
            self._close()

    def health(self) -> Health:
        """Return the present health of the device, with a sentence on what is wrong."""
        return self._health() if self._connected else Health("closed", "call connect() first")

    def _connect(self) -> None:
        """Open the device; by default there is nothing to open."""

    def _close(self) -> None:
        """Release the device's connections; some of them may not be open."""

    def _health(self) -> Health:
        return Health("ok")

    def _check_connected(self) -> None:
        if not self._connected:
            raise DriverError(f"{self.name!r} is not connected: call connect() first")

    def __enter__(self) -> Self:
        self.connect()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
