"""What a transducer is: it reads a force/torque sensor and says how far to trust each reading.

A reading is never frozen silently: it carries its age, and `health` names what is wrong. Nothing
here blocks but `connect`, which has a deadline.
"""

import bisect
from abc import abstractmethod
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from wrenchbed.errors import DriverError
from wrenchbed.hardware.device import STALE_S, Device

CLOSE_S = 1e-3
"""Readings that are less apart are not averaged [s]."""


@dataclass(frozen=True, eq=False)
class WrenchSample:
    """One reading.

    Attributes:
        t: `time.monotonic` of this machine when it arrived [s].
        device_time: on the sensor's own clock [s], None where it has none.
        sequence: of the sensor's samples, or of the replies where it counts none.
        age: time between arrival and the call that returned this [s].
        fresh: newer than what the call before returned.
        wrench: load on the tool side (6,) [N, N·m].
        frame: whose axes: ``sensor``, ``flange``, ``tcp`` or ``base``.
        reference: about whose origin the torques are: ``sensor``, ``flange`` or ``tcp``.
        status: the sensor's own status word.
        saturated: bit i is set where channel i is at the end of its range.
        lost: readings known to be lost since this device was made.
        bias_id: how often the zero was changed since this device was made.
        faults: what the status word says is wrong, in words.
    """

    t: float
    device_time: float | None
    sequence: int
    age: float
    fresh: bool
    wrench: np.ndarray
    frame: str = "sensor"
    reference: str = "sensor"
    status: int = 0
    saturated: int = 0
    lost: int = 0
    bias_id: int = 0
    faults: tuple[str, ...] = ()


class Transducer(Device):
    """A force/torque sensor with its electronics. Use as a context manager."""

    def read(self) -> WrenchSample:
        """The newest reading; never blocks."""
        self._check_connected()
        return self._read()

    def at(self, t: float) -> WrenchSample | None:
        """The reading as it was at a time of `time.monotonic` [s]; None where nothing is known.

        Its age is the time to the nearest reading, its flags are those of both neighbours.
        """
        self._check_connected()
        return self._at(t)

    def zero(self) -> int:
        """Make the present load read as zero; returns the new bias id.

        Raises:
            DriverError: this device cannot.
        """
        self._check_connected()
        return self._zero()

    @abstractmethod
    def _read(self) -> WrenchSample: ...

    @abstractmethod
    def _at(self, t: float) -> WrenchSample | None: ...

    def _zero(self) -> int:
        raise DriverError(f"transducer {self.name!r} cannot change its zero")


def weight(since: float, span: float) -> float:
    """Share of the later of two readings, some time [s] after the first, a span [s] apart.

    Of two that are less than `CLOSE_S` apart the nearer one counts, as it was read: a mean of both
    would be calmer than the sensor is. Else a straight line is drawn between them.
    """
    if span < CLOSE_S:
        return float(since >= 0.5 * span)
    return since / span


class Past:
    """Keeps the last readings; written by one thread, read by others."""

    def __init__(self, most: int) -> None:
        self._samples: deque[WrenchSample] = deque(maxlen=most)

    def add(self, sample: WrenchSample) -> None:
        """Keep one more, unless it is not newer than the last."""
        if not self._samples or sample.t > self._samples[-1].t:
            self._samples.append(sample)

    def clear(self) -> None:
        """Forget everything."""
        self._samples.clear()

    def at(self, t: float) -> WrenchSample | None:
        """A reading as it was at a time [s], between its neighbours as `weight` says.

        It has the flags of both. None before the first, after the last and in a gap.
        """
        samples = list(self._samples)
        k = bisect.bisect_left(samples, t, key=lambda sample: sample.t)
        if k == len(samples) or (k == 0 and samples[0].t > t):
            return None
        before, after = samples[max(k - 1, 0)], samples[k]
        span = after.t - before.t
        if span > STALE_S:
            return None
        share = weight(t - before.t, span)
        return replace(
            after,
            t=t,
            device_time=None,
            age=min(t - before.t, after.t - t),
            wrench=before.wrench + share * (after.wrench - before.wrench),
            status=before.status | after.status,
            saturated=before.saturated | after.saturated,
            faults=tuple(dict.fromkeys((*before.faults, *after.faults))),
        )
