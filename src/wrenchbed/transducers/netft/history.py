"""The last second of records, kept as they came and decoded only when asked."""

from collections import deque

import numpy as np

from wrenchbed.health import STALE_S
from wrenchbed.transducers.netft import datagrams

_BATCHES = 8192
_MOST_BEHIND = 2048
"""Records by which one may be older than the newest of its batch."""


class History:
    """Counts at any time of the last ``seconds``; written by one thread, read by others."""

    def __init__(self, seconds: float, period: float) -> None:
        self._seconds, self._period = seconds, period
        self._batches: deque[tuple[float, bytes]] = deque(maxlen=_BATCHES)

    def add(self, t: float, data: bytes) -> None:
        """Keep whole records whose newest arrived at t [s]."""
        self._batches.append((t, data))
        while self._batches[0][0] < t - self._seconds:
            self._batches.popleft()

    def clear(self) -> None:
        """Forget everything."""
        self._batches.clear()

    def at(self, t: float) -> np.ndarray | None:
        """Counts (6,) at a time [s], between records in a straight line; None where unknown."""
        around: list[tuple[float, bytes]] = []
        for batch in reversed(self._batches.copy()):
            around.append(batch)
            if batch[0] < t - 0.02:
                break
            if len(around) > 1 and batch[0] > t + 0.02:
                del around[0]
        if not around:
            return None
        times, counts = self._decode(around[::-1])
        slack = max(2.0 * self._period, 0.02)
        if not times[0] - slack <= t <= times[-1] + slack:
            return None
        k = int(np.clip(np.searchsorted(times, t), 1, len(times) - 1))
        if len(times) > 1 and times[k] - times[k - 1] > STALE_S:
            return None
        return np.array([np.interp(t, times, counts[:, k]) for k in range(6)])

    def _decode(self, batches: list[tuple[float, bytes]]) -> tuple[np.ndarray, np.ndarray]:
        times, counts = [], []
        for arrived, data in batches:
            words = np.frombuffer(data, dtype=">u4").reshape(-1, datagrams.SIZE // 4)
            behind = (words[-1, 0].astype(np.int64) - words[:, 0]) & 0xFFFFFFFF
            behind = np.where(behind < 1 << 31, behind, 0).clip(0, _MOST_BEHIND)
            times.append(arrived - behind * self._period)
            counts.append(words[:, 3:].astype(np.int32))
        t = np.concatenate(times)
        order = np.argsort(t, kind="stable")
        return t[order], np.concatenate(counts)[order].astype(float)
