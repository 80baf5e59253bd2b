"""From the load on a body's sensor to counts: units, zero, range, and what can go wrong."""

import threading
import time

import numpy as np

from wrenchbed.serving.body import Body
from wrenchbed.serving.netft.settings import NEWTON, NEWTON_METRE, SATURATED, Settings
from wrenchbed.serving.netft.timeline import Timeline
from wrenchbed.serving.netft.troubles import Troubles

_LARGEST = 2**31 - 1
_STANDS_S = 0.05


class Sensing:
    """A transducer and its electronics, sampled at `Settings.internal_rate` since power-up."""

    def __init__(self, body: Body, settings: Settings, troubles: Troubles) -> None:
        self._body, self._settings, self._troubles = body, settings, troubles
        self.range = np.asarray(body.sensor.calibration().range)
        unit = np.repeat([NEWTON[settings.force_unit], NEWTON_METRE[settings.torque_unit]], 3)
        per_unit = np.repeat([settings.counts_per_force, settings.counts_per_torque], 3)
        self.per_si = per_unit / unit
        """(6,) counts per newton and newton metre."""
        self.rating = self.range / unit
        """(6,) full scale in the box's units."""
        self.rate = settings.internal_rate
        self._timeline = Timeline(body.cycle)
        self._lock = threading.Lock()
        self._power_up = time.monotonic()
        self._raw = np.zeros(6)
        self._bias = np.zeros(6)
        self._frozen: np.ndarray | None = None
        self._skew = (0.0, 0.0, 1.0)
        self.status = 0
        self._drawn = 0

    def observe(self) -> None:
        """Look at the body's clock; to be called often."""
        self._timeline.observe(*self._body.punctual)

    def warm_up(self) -> None:
        """Draw a block of noise, which loads what its filters need."""
        self._body.readings(self._body.ahead + 1e-6 * np.arange(64))

    def tick(self, host: float) -> int:
        """Number of the newest sample at a time of this machine [s]."""
        return int((host - self._power_up) * self.rate)

    def host(self, tick: float) -> float:
        """When a sample is taken, in this machine's time [s]."""
        return self._power_up + tick / self.rate

    def ahead(self, tick: int, every: int) -> int:
        """How many samples from ``tick`` on, ``every`` so many, the body can tell already."""
        behind = self._body.ahead - self._timeline.shown(self.host(tick))
        return int(behind * self.rate / every) + 1 if behind >= 0.0 else 0

    def stands(self, now: float) -> bool:
        """Whether the body is so late that what it showed last is shown on."""
        return now - self._body.punctual[0] > _STANDS_S

    def sample(self, tick: int, every: int, n: int) -> tuple[np.ndarray, np.ndarray]:
        """Counts (n, 6) and status words (n,) of n samples."""
        shown = self._timeline.shown(self.host(tick))
        values, flagged = self._body.readings(shown + np.arange(n) * (every / self.rate))
        if not np.isfinite(values.sum()):
            values = np.nan_to_num(values)
        wrong = self._troubles if self._troubles.any else None
        if wrong and (one := wrong.now("saturate")):
            values[:, int(one["channel"])] = self.range[int(one["channel"])]
        status = np.zeros(n, dtype=np.int64)
        over = np.abs(values) >= self.range
        if over.any() or flagged.any():
            status[over.any(axis=1) | (flagged != 0)] = SATURATED[self._settings.product]
        raw = np.maximum(np.minimum(values, self.range), -self.range) * self.per_si
        with self._lock:
            self._raw = raw[-1]
            counts = raw - self._bias
        if wrong and (one := wrong.now("wrong_counts")):
            counts *= one["factor"]
        if wrong and (one := wrong.now("status")):
            status |= int(one["bits"])
        self.status = int(status[-1])
        counts = np.maximum(np.minimum(np.rint(counts), _LARGEST), -_LARGEST).astype(np.int64)
        return self._frost(self._flicker(counts)), status

    def zero(self) -> None:
        """Software bias: what is measured now reads as zero from now on."""
        with self._lock:
            self._bias = self._raw.copy()

    @property
    def bias(self) -> np.ndarray:
        """(6,) counts that read as zero."""
        return self._bias

    @property
    def newest(self) -> np.ndarray:
        """(6,) counts of the newest sample."""
        return self._raw - self._bias

    def set_bias(self, channel: int, counts: float) -> None:
        """Change one channel's zero."""
        with self._lock:
            self._bias = np.where(np.arange(6) == channel, counts, self._bias)

    def restart(self) -> None:
        """Power off and on: samples are counted from 0 and the zero is lost."""
        with self._lock:
            self._power_up = time.monotonic()
            self._bias = np.zeros(6)
            self._skew = (0.0, 0.0, 1.0)

    def stamps(self, ticks: np.ndarray) -> np.ndarray:
        """ft_sequence (n,) of samples: their number, unless the clock runs wrong."""
        since, stamp, last = self._skew
        wrong = self._troubles.now("skew")
        factor = wrong["factor"] if wrong else 1.0
        if factor != last:
            since, stamp = float(ticks[0]), stamp + last * (float(ticks[0]) - since)
            self._skew = (since, stamp, factor)
        return np.asarray(np.rint(stamp + factor * (ticks - since)), dtype=np.int64)

    def _flicker(self, counts: np.ndarray) -> np.ndarray:
        """Without noise the last bit of a converter still flickers."""
        if (counts[0] == counts[-1]).all() and (counts == counts[0]).all():
            counts[:, 5] += (self._drawn + np.arange(len(counts))) & 1
            self._drawn += len(counts)
        return counts

    def _frost(self, counts: np.ndarray) -> np.ndarray:
        if self._troubles.now("freeze") is None:
            self._frozen = None
        elif self._frozen is None:
            self._frozen = counts[0].copy()
        return counts if self._frozen is None else np.tile(self._frozen, (len(counts), 1))
