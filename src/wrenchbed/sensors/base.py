"""What a six-axis force/torque sensor is: calibrations, noise, body and certified accuracy.

A new sensor is one file of data, see `described`. Another package may also give a `Sensor` through
an entry point.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from wrenchbed.errors import NotFoundError, ParameterError
from wrenchbed.physics.noise import SATURATED_BITS, Array, NoiseModel, channels

STATUS_SATURATED = int(SATURATED_BITS.sum())
"""Mask 0x3F of the status word: bit 0 fx, 1 fy, 2 fz, 3 tx, 4 ty, 5 tz is set where it saturates
(docs/contracts.md, column ``saturated``). Other bits are a device's own and mean nothing here."""


@dataclass(frozen=True, eq=False)
class SensorCalibration:
    """One of the measuring ranges that a sensor is sold with.

    Attributes:
        name: the maker's, for instance ``SI-65-5``: up to 65 N across and 5 N·m.
        range: (6,) full scale ± per channel fx fy fz tx ty tz [N, N·m].
        resolution: (6,) smallest step that the data sheet promises with a 16-bit converter [N,
            N·m]. The step of the output words may be finer: see ``NoiseModel.resolution``.
        source: where both come from, and what of it was not seen in the maker's own words.
    """

    name: str
    range: Array
    resolution: Array
    source: str

    def __post_init__(self) -> None:
        for name in ("range", "resolution"):
            value = channels(getattr(self, name), f"{self.name}.{name}")
            if not (value > 0).all():
                raise ParameterError(f"{self.name}.{name} must be positive in every channel")
            object.__setattr__(self, name, value)


@dataclass(frozen=True, eq=False)
class Sensor:
    """A kind of six-axis force/torque sensor as it is sold.

    Attributes:
        name: registry name.
        title: one line for people.
        calibrations: the ranges it is sold with.
        default: name of the calibration that ``noise`` belongs to.
        mass: of the complete sensor [kg]; ``…_source`` says where this and other values come from.
        noise: noise of one row at rest, see ``NoiseModel``.
        accuracy: (6,) certified accuracy ± [N, N·m], None where no certificate is known.
        plate_offset: (3,) from the middle of the face on the robot's side to the origin of the
            wrench, in sensor axes [m].
        counts: (6,) counts of the digital output per newton and newton metre, None where the output
            is a floating-point number.
        gauges: (6, 6) matrix from gauge voltages to the wrench [N/V, N·m/V] of one sensor, None
            where none is known.
        record: TOML text, from which `described.rebuilt` makes a user's sensor; None if shipped.
    """

    name: str
    title: str
    calibrations: tuple[SensorCalibration, ...]
    default: str
    mass: float
    mass_source: str
    noise: NoiseModel
    noise_source: str
    accuracy: Array | None = None
    accuracy_source: str = ""
    plate_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    plate_offset_source: str = ""
    counts: Array | None = None
    counts_source: str = ""
    gauges: Array | None = None
    gauges_source: str = ""
    record: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        self.calibration()
        if self.accuracy is not None:
            object.__setattr__(self, "accuracy", channels(self.accuracy, f"{self.name}.accuracy"))

    def calibration(self) -> SensorCalibration:
        """Return the default calibration; a `NotFoundError` if ``default`` names none."""
        known = {c.name: c for c in self.calibrations}
        if self.default not in known:
            raise NotFoundError(f"{self.name}: {self.default!r} is none of {', '.join(known)}")
        return known[self.default]
