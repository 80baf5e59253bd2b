"""The last second of records, kept as they came and decoded only when asked."""

from collections import deque
from typing import NamedTuple

import numpy as np

from wrenchbed.health import STALE_S
from wrenchbed.transducers.base import weight
from wrenchbed.transducers.netft import datagrams

_BATCHES = 8192
_AROUND_S = 0.005
"""How far beyond the batches next to a time others are decoded, too [s]."""
_MOST_BEHIND = 2048
"""Records by which one may be older than the newest of its batch."""


class Known(NamedTuple):
    """Counts (6,) at a time, the status bits around it, and how far the nearest record is [s]."""

    counts: np.ndarray
    status: int
    age: float


class History:
    """Counts at any time of the last ``seconds``; written by one thread, read by others."""

    def __init__(self, seconds: float, period: float) -> None:
        self._seconds, self._period = seconds, period
        self._batches: deque[tuple[float, bytes]] = deque(maxlen=_BATCHES)

    def add(self, t: float, data: bytes) -> None:
        """Keep whole records whose last arrived at t [s], or would have, had it been in time."""
        self._batches.append((t, data))
        while self._batches[0][0] < t - self._seconds:
            self._batches.popleft()

    def clear(self) -> None:
        """Forget everything."""
        self._batches.clear()

    def at(self, t: float) -> Known | None:
        """What was at a time [s], between records as `weight` says; None where unknown."""
        around: list[tuple[float, bytes]] = []
        for batch in reversed(self._batches.copy()):
            around.append(batch)
            if batch[0] < t - _AROUND_S:
                break
            if len(around) > 1 and batch[0] > t + _AROUND_S:
                del around[0]
        if not around:
            return None
        times, status, counts = self._decode(around[::-1])
        if not times[0] <= t <= times[-1]:
            return None
        k = int(np.clip(np.searchsorted(times, t), min(1, len(times) - 1), len(times) - 1))
        span = times[k] - times[k - 1]
        if span > STALE_S:
            return None
        share = weight(t - times[k - 1], span)
        between = counts[k - 1] + share * (counts[k] - counts[k - 1])
        age = min(abs(t - times[k - 1]), abs(times[k] - t))
        return Known(between, int(status[k - 1] | status[k]), float(age))

    def _decode(
        self, batches: list[tuple[float, bytes]]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        times, status, counts = [], [], []
        for arrived, data in batches:
            words = np.frombuffer(data, dtype=">u4").reshape(-1, datagrams.SIZE // 4)
            behind = (words[-1, 0].astype(np.int64) - words[:, 0]) & 0xFFFFFFFF
            behind = np.where(behind < 1 << 31, behind, 0).clip(0, _MOST_BEHIND)
            times.append(arrived - behind * self._period)
            status.append(words[:, 2])
            counts.append(words[:, 3:].astype(np.int32))
        t = np.concatenate(times)
        order = np.argsort(t, kind="stable")
        flags, values = np.concatenate(status)[order], np.concatenate(counts)[order]
        return t[order], flags, values.astype(float)
