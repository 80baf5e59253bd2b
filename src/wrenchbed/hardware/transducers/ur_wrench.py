"""A UR robot's own wrench over RTDE, in the sensor's axes: a driver of UR robots reads it.

Where the controller has it (e-Series from 5.9), ``ft_raw_wrench``: the flange's sensor, not
compensated for the payload, taken as it is. Else ``actual_TCP_force``: in the base's axes, without
the payload's weight; about the TCP on a CB3, which estimates it from motor currents to some ten
newtons, and about the flange on an e-Series. Both count as the load of the world on the tool side;
check the sign once on the robot's software version by a push.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

from wrenchbed.errors import DriverError
from wrenchbed.hardware.device import Health, by_age
from wrenchbed.hardware.transducers.base import Transducer, WrenchSample


@dataclass(frozen=True)
class UrWrenchOptions:
    """Where readings come from.

    Attributes:
        source: returns the newest reading, in the sensor's axes about its origin, without blocking.
    """

    source: Callable[[], WrenchSample] | None = None


class UrWrench(Transducer):
    """The robot's own wrench in the sensor's axes about the sensor's origin."""

    name = "ur-wrench"
    title = "a UR robot's own wrench over RTDE"
    options = UrWrenchOptions

    def __init__(self, options: UrWrenchOptions | None = None) -> None:
        super().__init__()
        self._source = (options or UrWrenchOptions()).source

    def _connect(self) -> None:
        self._read()

    def _close(self) -> None:
        self._past.clear()

    def _read(self) -> WrenchSample:
        if self._source is None:
            raise DriverError("transducer 'ur-wrench' is read by driver 'rtde' only")
        sample = self._source()
        self._past.add(sample)
        return sample

    def _at(self, t: float) -> WrenchSample | None:
        self._read()
        return super()._at(t)

    def _health(self) -> Health:
        sample = self._read()
        counters = {"readings": float(sample.sequence), "lost": float(sample.lost)}
        return by_age(time.monotonic() - sample.t, "the robot's own wrench", counters)


TRANSDUCER = UrWrench
