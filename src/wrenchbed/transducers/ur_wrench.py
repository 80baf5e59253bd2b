"""A UR robot's own wrench over RTDE, brought into the sensor's axes.

Where the controller has it (e-Series from 5.9), ``ft_raw_wrench``: the flange's sensor, not
compensated for the payload, taken as it is. Else ``actual_TCP_force``: in the base's axes, without
the payload's weight; about the TCP on a CB3, which estimates it from motor currents to some ten
newtons, and about the flange on an e-Series. Both are taken as the load that the world puts on the
tool side; the sign on a robot's own software version should be checked once by a push.
"""

import bisect
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wrenchbed.errors import DriverError
from wrenchbed.health import Health, by_age
from wrenchbed.transducers.base import Transducer, WrenchSample

_HISTORY = 512


@dataclass(frozen=True, eq=False)
class Reading:
    """What the controller said.

    Attributes:
        t: `time.monotonic` of its arrival [s].
        device_time: on the controller's clock [s].
        sequence: of the states received.
        lost: states known to be lost.
        wrench: (6,) [N, N·m] as the controller gives it.
        rotation: R_given_sensor (3, 3), from the sensor's axes to those of ``wrench``.
        lever: from the sensor's origin to the point that the torque is about (3,), in the axes of
            ``wrench`` [m].
    """

    t: float
    device_time: float
    sequence: int
    lost: int
    wrench: np.ndarray
    rotation: np.ndarray
    lever: np.ndarray


@dataclass(frozen=True)
class Options:
    """Where readings come from.

    Attributes:
        source: gives the newest reading without blocking; a driver of UR robots has it.
    """

    source: Callable[[], Reading] | None = None


class UrWrench(Transducer):
    """The robot's own wrench in the sensor's axes about the sensor's origin."""

    name = "ur-wrench"
    title = "a UR robot's own wrench over RTDE"
    options = Options

    def __init__(self, options: Options | None = None) -> None:
        super().__init__()
        self._source = (options or Options()).source
        self._seen = -1
        self._past: deque[tuple[float, np.ndarray]] = deque(maxlen=_HISTORY)

    def _open(self) -> None:
        if self._source is None:
            raise DriverError("transducer 'ur-wrench' is read by driver 'rtde' only")
        self._newest()

    def _shut(self) -> None:
        self._past.clear()
        self._seen = -1

    def _read(self) -> WrenchSample:
        reading, wrench = self._take()
        fresh, self._seen = reading.sequence != self._seen, reading.sequence
        age = time.monotonic() - reading.t
        return WrenchSample(
            reading.t, reading.device_time, reading.sequence, age, fresh, wrench,
            lost=reading.lost,
        )  # fmt: skip

    def _take(self) -> tuple[Reading, np.ndarray]:
        """The newest reading, remembered, and its wrench in the sensor's axes."""
        reading = self._newest()
        if not self._past or reading.t > self._past[-1][0]:
            self._past.append((reading.t, in_sensor_axes(reading)))
        return reading, self._past[-1][1]

    def _at(self, t: float) -> np.ndarray | None:
        self._take()
        past = list(self._past)
        k = bisect.bisect_left(past, t, key=lambda known: known[0])
        if k == len(past) or (k == 0 and past[0][0] > t):
            return None
        (before, first), (after, second) = past[max(k - 1, 0)], past[k]
        share = (t - before) / (after - before) if after > before else 1.0
        return np.asarray(first + share * (second - first))

    def _health(self) -> Health:
        reading = self._newest()
        counters = {"readings": float(reading.sequence), "lost": float(reading.lost)}
        return by_age(time.monotonic() - reading.t, "the robot's own wrench", counters)

    def _newest(self) -> Reading:
        assert self._source is not None
        return self._source()


def in_sensor_axes(reading: Reading) -> np.ndarray:
    """The wrench (6,) in the sensor's axes about its origin."""
    force, torque = reading.wrench[:3], reading.wrench[3:]
    back = reading.rotation.T
    return np.concatenate([back @ force, back @ (torque + np.cross(reading.lever, force))])


TRANSDUCER = UrWrench
