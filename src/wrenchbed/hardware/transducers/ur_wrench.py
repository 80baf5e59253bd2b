"""A UR robot's own wrench over RTDE, brought into the sensor's axes.

Where the controller has it (e-Series from 5.9), ``ft_raw_wrench``: the flange's sensor, not
compensated for the payload, taken as it is. Else ``actual_TCP_force``: in the base's axes, without
the payload's weight; about the TCP on a CB3, which estimates it from motor currents to some ten
newtons, and about the flange on an e-Series. Both count as the load of the world on the tool side;
check the sign once on the robot's software version by a push.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wrenchbed.errors import DriverError
from wrenchbed.hardware.device import Health, by_age
from wrenchbed.hardware.transducers.base import Transducer, WrenchSample


@dataclass(frozen=True, eq=False)
class UrWrenchReading:
    """The wrench as the controller reports it.

    Attributes:
        t: `time.monotonic` of its arrival [s].
        device_time: on the controller's clock [s].
        sequence: of the states received.
        lost: states known to be lost.
        wrench: (6,) [N, N·m] as reported.
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
class UrWrenchOptions:
    """Where readings come from.

    Attributes:
        source: returns the newest reading without blocking; a driver of UR robots has it.
    """

    source: Callable[[], UrWrenchReading] | None = None


class UrWrench(Transducer):
    """The robot's own wrench in the sensor's axes about the sensor's origin."""

    name = "ur-wrench"
    title = "a UR robot's own wrench over RTDE"
    options = UrWrenchOptions

    def __init__(self, options: UrWrenchOptions | None = None) -> None:
        super().__init__()
        self._source = (options or UrWrenchOptions()).source

    def _connect(self) -> None:
        if self._source is None:
            raise DriverError("transducer 'ur-wrench' is read by driver 'rtde' only")
        self._newest()

    def _close(self) -> None:
        self._past.clear()

    def _read(self) -> WrenchSample:
        reading = self._newest()
        sample = WrenchSample(
            reading.t, reading.device_time, reading.sequence, 0.0, True, in_sensor_axes(reading),
            lost=reading.lost,
        )  # fmt: skip
        self._past.add(sample)
        return sample

    def _at(self, t: float) -> WrenchSample | None:
        self._read()
        return super()._at(t)

    def _health(self) -> Health:
        reading = self._newest()
        counters = {"readings": float(reading.sequence), "lost": float(reading.lost)}
        return by_age(time.monotonic() - reading.t, "the robot's own wrench", counters)

    def _newest(self) -> UrWrenchReading:
        assert self._source is not None
        return self._source()


def in_sensor_axes(reading: UrWrenchReading) -> np.ndarray:
    """The wrench (6,) in the sensor's axes about its origin."""
    force, torque = reading.wrench[:3], reading.wrench[3:]
    back = reading.rotation.T
    return np.concatenate([back @ force, back @ (torque + np.cross(reading.lever, force))])


TRANSDUCER = UrWrench
