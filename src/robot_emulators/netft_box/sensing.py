"""The box's sensor: converts the plant's load to counts, with the box's settings and faults."""

import threading
import time
from dataclasses import dataclass
from functools import partial

import numpy as np

from robot_emulators.base.faults import Faults
from robot_emulators.base.named_values import Settings, above, integer, number, setting, word
from robot_emulators.plant import Plant

INTERNAL_RATE = 7000
"""Samples that a box takes per second [Hz]; source: ATI 9620-05."""
NEWTON = {"N": 1.0, "kN": 1e3, "lbf": 4.4482216152605, "klbf": 4448.2216152605, "kgf": 9.80665}
"""Unit of force → its size [N]."""
NEWTON_METRE = {
    "Nm": 1.0, "Nmm": 1e-3, "kNm": 1e3, "lbf-in": 0.1129848290276167,
    "lbf-ft": 1.3558179483314004, "kgf-cm": 0.0980665,
}  # fmt: skip
"""Unit of torque → its size [N·m]."""
LARGEST_BUFFER = 40
"""Most records of a buffered datagram; source: ATI 9620-05."""
SATURATED = 1 << 31 | 1 << 17
"""Status word of a sample outside the sensor's range; source: ATI 9620-05."""
_LARGEST = 2**31 - 1
_SHORTEST_S, _SLACK_S = 8e-3, 2e-3
"""Least delay of samples behind the plant's newest state, and an addition for late steps [s]. A
reading between two states exists only once the later one does, so that it is a cycle late, and a
block of samples at a time costs least. The delay is constant; a late state is waited for."""
_STALE_S = 0.05
"""Age of the plant's newest state [s] from which its last reading is repeated, as by a box that
does not know its robot; below it, a late cycle would change the readings."""


@dataclass(frozen=True)
class BoxSettings(Settings):
    """Settings of a Net F/T box at power-up: units, counts, rate and ports."""

    rdt_port: int = setting(49152, integer(0, 65535), "UDP port of RDT, default 49152")
    http_port: int = setting(
        0, integer(0, 65535),
        "TCP port of HTTP; 0 (default) takes 80, or 8080 where 80 is not allowed",
    )  # fmt: skip
    rate: float = setting(
        7000.0, number(1.0, INTERNAL_RATE),
        "RDT records per second, default 7000; rounded up to internal samples / whole number",
    )  # fmt: skip
    counts_per_force: float = setting(1e6, above(0.0), "counts per unit of force, default 1000000")
    counts_per_torque: float = setting(
        1e6, above(0.0), "counts per unit of torque, default 1000000"
    )
    force_unit: str = setting("N", word(NEWTON), "N (default), kN, lbf, klbf or kgf")
    torque_unit: str = setting(
        "Nm", word(NEWTON_METRE), "Nm (default), Nmm, kNm, lbf-in, lbf-ft or kgf-cm"
    )


class Sensing:
    """A force/torque sensor and its electronics; its samples at `INTERNAL_RATE` are numbered."""

    def __init__(self, body: Plant, settings: BoxSettings, faults: Faults) -> None:
        self._body, self._faults = body, faults
        self._fault = partial(faults.now, "rdt")
        self.range = np.asarray(body.sensor_range)
        unit = np.repeat([NEWTON[settings.force_unit], NEWTON_METRE[settings.torque_unit]], 3)
        counts = np.repeat([settings.counts_per_force, settings.counts_per_torque], 3)
        self.per_si = counts / unit
        """(6,) counts per newton and newton metre."""
        self.rate = INTERNAL_RATE
        self._lag, self._offset = max(body.cycle, _SHORTEST_S) + _SLACK_S, 0.0
        self._lock = threading.Lock()
        self._power_up = time.monotonic()
        self._raw = np.zeros(6)
        self.bias = np.zeros(6)
        """(6,) counts that are subtracted from readings: the zero."""
        self._frozen: np.ndarray | None = None
        self._skew = (0.0, 0.0, 1.0)
        self.status = 0
        self._drawn = 0

    def observe(self) -> None:
        """Update the offset between this machine's clock and simulated time; call it often."""
        due, newest = self._body.newest
        self._offset = due - newest

    def simulated(self, host: float) -> float:
        """Simulated time [s] of the sample that is taken at a `time.monotonic` time [s]."""
        return host - self._offset - self._lag

    def warm_up(self) -> None:
        """Read the plant's sensor once, so that later readings need not load modules."""
        self._body.readings(self._body.newest[1] + 1e-6 * np.arange(64))

    def tick(self, host: float) -> int:
        """Number of the newest sample at a `time.monotonic` time [s]."""
        return int((host - self._power_up) * self.rate)

    def host(self, tick: float) -> float:
        """`time.monotonic` time [s] at which the sample of this number is taken."""
        return self._power_up + tick / self.rate

    def ahead(self, tick: int, every: int) -> int:
        """Number of samples from ``tick`` on, ``every`` apart, that the plant can give now."""
        behind = self._body.newest[1] - self.simulated(self.host(tick))
        return int(behind * self.rate / every) + 1 if behind >= 0.0 else 0

    def stale(self, now: float) -> bool:
        """Whether the plant is so late at time ``now`` [s] that its last reading is repeated."""
        return now - self._body.newest[0] > _STALE_S

    def sample(self, tick: int, every: int, n: int) -> tuple[np.ndarray, np.ndarray]:
        """Force/torque counts (n, 6) and status words (n,) of n samples, from number ``tick`` on
        and ``every`` samples apart; faults are applied."""
        t = self.simulated(self.host(tick))
        values, flagged = self._body.readings(t + np.arange(n) * (every / self.rate))
        if not np.isfinite(values.sum()):
            values = np.nan_to_num(values)
        wrong = self._fault if self._faults.any("rdt") else None
        if wrong and (one := wrong("saturate")):
            values[:, int(one["channel"])] = self.range[int(one["channel"])]
        status = np.zeros(n, dtype=np.int64)
        over = np.abs(values) >= self.range
        if over.any() or flagged.any():
            status[over.any(axis=1) | (flagged != 0)] = SATURATED
        raw = np.maximum(np.minimum(values, self.range), -self.range) * self.per_si
        with self._lock:
            self._raw = raw[-1]
            counts = raw - self.bias
        if wrong and (one := wrong("wrong_counts")):
            counts *= one["factor"]
        if wrong and (one := wrong("status")):
            status |= int(one["bits"])
        self.status = int(status[-1])
        counts = np.maximum(np.minimum(np.rint(counts), _LARGEST), -_LARGEST).astype(np.int64)
        counts = self._flicker(counts)
        if self._fault("freeze") is None:
            self._frozen = None
            return counts, status
        self._frozen = counts[0].copy() if self._frozen is None else self._frozen
        return np.tile(self._frozen, (len(counts), 1)), status

    def zero(self) -> None:
        """Zero the sensor: subtract the present reading from now on."""
        with self._lock:
            self.bias = self._raw.copy()

    @property
    def newest(self) -> np.ndarray:
        """Force/torque counts (6,) of the newest sample, bias subtracted."""
        return self._raw - self.bias

    def set_bias(self, channel: int, counts: float) -> None:
        """Set the bias [count] that is subtracted from one channel, 0 … 5."""
        with self._lock:
            self.bias = np.where(np.arange(6) == channel, counts, self.bias)

    def restart(self) -> None:
        """Switch the box off and on: samples count from 0 and the bias is 0."""
        with self._lock:
            self._power_up = time.monotonic()
            self.bias = np.zeros(6)
            self._skew = (0.0, 0.0, 1.0)

    def rescale(self, factor: float) -> None:
        """Change the calibration: multiply counts per N and per N·m, and the bias, by a factor."""
        with self._lock:
            self.per_si, self.bias = factor * self.per_si, factor * self.bias

    def stamps(self, ticks: np.ndarray) -> np.ndarray:
        """Numbers (n,) that samples ``ticks`` (n,) have in records; they drift under fault skew."""
        since, stamp, last = self._skew
        wrong = self._fault("skew")
        factor = wrong["factor"] if wrong else 1.0
        if factor != last:
            since, stamp = float(ticks[0]), stamp + last * (float(ticks[0]) - since)
            self._skew = (since, stamp, factor)
        return np.asarray(np.rint(stamp + factor * (ticks - since)), dtype=np.int64)

    def _flicker(self, counts: np.ndarray) -> np.ndarray:
        """Toggle the last bit of noise-free counts (n, 6), as an A/D converter would."""
        if (counts[0] == counts[-1]).all() and (counts == counts[0]).all():
            counts[:, 5] += (self._drawn + np.arange(len(counts))) & 1
            self._drawn += len(counts)
        return counts
