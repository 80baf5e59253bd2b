"""The contract of a transducer: it reads a force/torque sensor and states the age of each reading.
A frozen reading is always visible: it has an age, and `health` says what is wrong. Only `connect`
blocks, and it has a deadline. A transducer implements the methods with an underscore."""

import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wrenchbed.hardware.device_base import STALE_S, Device

CLOSE_S = 1e-3
"""Readings nearer in time are not interpolated [s]: joints move by less than their noise in it."""
KEPT_S = 1.5
"""Age up to which readings are stored [s]: longer than a row of a motion waits for its wrench."""
_BATCHES = 8192
"""Most batches of readings that are stored: `KEPT_S` of one a millisecond, and a margin."""


@dataclass(frozen=True, eq=False)
class WrenchSample:
    """One reading of a force/torque sensor.

    Attributes:
        t: `time.monotonic` of this machine when it arrived [s].
        device_time: time on the sensor's own clock [s], None if it has none.
        sequence: number of the sensor's sample, or of its reply if it numbers none.
        age: time between arrival and the call that returned this [s].
        fresh: whether it is newer than the reading that the previous call returned.
        wrench: load on the tool side (6,) [N, N·m], in the sensor's axes about its origin.
        status: the sensor's own status word.
        saturated: bit i is set where channel i is at the end of its range.
        lost: readings known to be lost since this device was made.
        bias_id: how often the device lost its zero since this object was made.
        faults: faults in the status word, as texts.
    """

    t: float
    device_time: float | None
    sequence: int
    age: float
    fresh: bool
    wrench: np.ndarray
    status: int = 0
    saturated: int = 0
    lost: int = 0
    bias_id: int = 0
    faults: tuple[str, ...] = ()


class PastReading(NamedTuple):
    """Sensor reading at a past time, between two stored readings.

    Attributes:
        wrench: wrench (6,) [N, N·m], interpolated.
        status, saturated: status words and saturated channels of both readings, combined by or.
        age: time to the nearer of both readings [s].
    """

    wrench: np.ndarray
    status: int
    saturated: int
    age: float


class Past:
    """Buffer of the last readings, in batches; one thread writes it, others read it."""

    def __init__(self) -> None:
        self._batches: deque[tuple[np.ndarray, ...]] = deque(maxlen=_BATCHES)

    def add(
        self, t: ArrayLike, wrench: ArrayLike, status: ArrayLike = 0, saturated: ArrayLike = 0
    ) -> None:
        """Append readings (n, 6) at times (n,) [s], with status words and bits of saturated
        channels, (n,) or one for all; a time before its predecessor is set to it."""
        times = np.maximum.accumulate(np.atleast_1d(np.asarray(t, dtype=float)))
        if self._batches:
            times = np.maximum(times, self._batches[-1][0][-1])
        flags = (np.broadcast_to(np.asarray(f, np.int64), times.shape) for f in (status, saturated))
        self._batches.append((times, np.asarray(wrench, dtype=float).reshape(-1, 6), *flags))
        while self._batches[0][0][-1] < times[-1] - KEPT_S:
            self._batches.popleft()

    def clear(self) -> None:
        """Drop all stored readings."""
        self._batches.clear()

    def at(self, t: float) -> PastReading | None:
        """Return the stored reading at a time [s]; None before the first, after the last, in a gap.
        Between two readings it is interpolated linearly. If they are less than `CLOSE_S` apart, the
        nearer one counts: a mean of both would have less noise than the sensor."""
        around: list[tuple[np.ndarray, ...]] = []
        for batch in reversed(self._batches.copy()):
            around = [batch, *around[:1]]
            if batch[0][0] <= t:
                break
        if not around:
            return None
        times, wrench, *flags = (np.concatenate(column) for column in zip(*around, strict=True))
        after = min(max(int(np.searchsorted(times, t)), 1), len(times) - 1)
        before = max(after - 1, 0)
        span, since = times[after] - times[before], t - times[before]
        if not times[0] <= t <= times[-1] or span > STALE_S:
            return None
        later = float(since >= 0.5 * span) if span < CLOSE_S else since / span
        status, saturated = (int(word[before] | word[after]) for word in flags)
        between = wrench[before] + later * (wrench[after] - wrench[before])
        return PastReading(between, status, saturated, float(min(since, abs(span - since))))


class Transducer(Device, ABC):
    """Base class of force/torque sensors with their electronics; use as a context manager."""

    def __init__(self) -> None:
        super().__init__()
        self._past = Past()
        self._last_read: tuple[int, float] | None = None

    def read(self) -> WrenchSample:
        """Return the newest reading with its age, without blocking."""
        self._check_connected()
        sample = self._read()
        key = (sample.sequence, sample.t)
        fresh, self._last_read = key != self._last_read, key
        return replace(sample, age=max(0.0, time.monotonic() - sample.t), fresh=fresh)

    def at(self, t: float) -> WrenchSample | None:
        """Return the reading at a `time.monotonic` time [s], interpolated; None if none is near.
        Its age is the time to the nearest reading, its flags are those of both neighbours."""
        self._check_connected()
        return self._at(t)

    @property
    def full_scale(self) -> np.ndarray | None:
        """Measuring range (6,) [N, N·m] that the connected device reports; None if it does not."""
        return None

    @property
    def identity(self) -> Mapping[str, Any]:
        """Facts that the connected device reports about itself, for a recording's metadata."""
        return {}

    @abstractmethod
    def _read(self) -> WrenchSample:
        """Return the newest reading; `read` sets its age and whether it is fresh."""

    def _at(self, t: float) -> WrenchSample | None:
        newest, past = self._read(), self._past.at(t)
        return None if past is None else replace(newest, t=t, device_time=None, **past._asdict())
