"""The contract of a transducer: it reads a force/torque sensor and states the age of each reading.

A frozen reading is always visible: it carries its age, and `health` names what is wrong. Only
`connect` blocks, and it has a deadline. A transducer fills in the methods with an underscore.
"""

import bisect
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar
from urllib.parse import SplitResult, urlsplit

import numpy as np

from wrenchbed import registry
from wrenchbed.errors import ParameterError
from wrenchbed.hardware.device import STALE_S, Device

CLOSE_S = 1e-3
"""Readings closer in time are not interpolated [s]: a robot's joints move less than their noise."""
HISTORY = 1024
"""Readings that are kept: four seconds at 250 Hz, twice what a row of a motion may wait."""


@dataclass(frozen=True, eq=False)
class WrenchSample:
    """One reading of a force/torque sensor.

    Attributes:
        t: `time.monotonic` of this machine when it arrived [s].
        device_time: on the sensor's own clock [s], None where it has none.
        sequence: of the sensor's samples, or of the replies where it counts none.
        age: time between arrival and the call that returned this [s].
        fresh: newer than what the call before returned.
        wrench: load on the tool side (6,) [N, N·m], in the sensor's axes about its origin.
        status: the sensor's own status word.
        saturated: bit i is set where channel i is at the end of its range.
        lost: readings known to be lost since this device was made.
        bias_id: how often the device lost its zero since this object was made.
        faults: meaning of the status word, in words.
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


class Transducer(Device, ABC):
    """A force/torque sensor with its electronics. Use as a context manager."""

    form: ClassVar[str] = ""
    """Address ``NAME://…`` that names one, for people; empty where none does."""

    @classmethod
    def at_address(cls, parts: SplitResult) -> "Transducer":
        """One that an address of this `form` names; closed.

        Raises:
            ParameterError: the address is wrong, and why.
        """
        raise ParameterError(f"transducer {cls.name!r} has no address")

    def __init__(self) -> None:
        super().__init__()
        self._past = Past(HISTORY)
        self._last_read: tuple[int, float] | None = None

    def read(self) -> WrenchSample:
        """The newest reading with its age; never blocks."""
        self._check_connected()
        sample = self._read()
        key = (sample.sequence, sample.t)
        fresh, self._last_read = key != self._last_read, key
        return replace(sample, age=max(0.0, time.monotonic() - sample.t), fresh=fresh)

    def at(self, t: float) -> WrenchSample | None:
        """Reading at a time of `time.monotonic` [s], interpolated; None if none is known near that
        time.

        Its age is the time to the nearest reading, its flags are those of both neighbours.
        """
        self._check_connected()
        return self._at(t)

    @property
    def full_scale(self) -> np.ndarray | None:
        """Range (6,) [N, N·m] that the connected device reports; None if it reports none."""
        return None

    @property
    def identity(self) -> Mapping[str, Any]:
        """Facts that the connected device reports of itself, for a recording's metadata."""
        return {}

    @abstractmethod
    def _read(self) -> WrenchSample:
        """The newest reading; `read` sets its age and whether it is fresh."""

    def _at(self, t: float) -> WrenchSample | None:
        return self._past.at(t)


def weight(since: float, span: float) -> float:
    """Weight of the later of two readings, some time [s] after the first, a span [s] apart.

    Of two that are less than `CLOSE_S` apart the nearer one counts: a mean of both would have less
    noise than the sensor. Else the reading is interpolated linearly.
    """
    if span < CLOSE_S:
        return float(since >= 0.5 * span)
    return since / span


class Past:
    """The last readings; written by one thread, read by others."""

    def __init__(self, most: int) -> None:
        self._samples: deque[WrenchSample] = deque(maxlen=most)

    def add(self, sample: WrenchSample) -> None:
        """Keep one more reading, if it is newer than the last."""
        if not self._samples or sample.t > self._samples[-1].t:
            self._samples.append(sample)

    def clear(self) -> None:
        """Drop all readings."""
        self._samples.clear()

    def at(self, t: float) -> WrenchSample | None:
        """The reading at a time [s], interpolated between its neighbours by `weight`.

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
        later = weight(t - before.t, span)
        return replace(
            after,
            t=t,
            device_time=None,
            age=min(t - before.t, after.t - t),
            wrench=before.wrench + later * (after.wrench - before.wrench),
            status=before.status | after.status,
            saturated=before.saturated | after.saturated,
            faults=tuple(dict.fromkeys((*before.faults, *after.faults))),
        )


def forms() -> str:
    """The addresses that registered transducers can be given by, with commas between them."""
    kinds = (registry.load("transducers", name) for name in registry.names("transducers"))
    return ", ".join(kind.form for kind in kinds if getattr(kind, "form", ""))


def transducer_at(address: str) -> Transducer:
    """The transducer that an address ``NAME://…`` names, NAME as in the registry; closed.

    Raises:
        ParameterError: it names none; the message lists the forms.
    """
    try:
        parts = urlsplit(address)
    except ValueError as error:
        raise ParameterError(f"sensor {address!r}: {error}: give {forms()}") from error
    if parts.scheme in registry.names("transducers"):
        kind = registry.load("transducers", parts.scheme)
        if getattr(kind, "form", ""):
            try:
                transducer: Transducer = kind.at_address(parts)
            except (ParameterError, ValueError) as error:
                raise ParameterError(f"sensor {address!r}: {error}: give {kind.form}") from error
            return transducer
    raise ParameterError(f"sensor {address!r}: give {forms()}")
