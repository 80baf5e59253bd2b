"""What a six-axis force/torque sensor is: its calibrations, its noise and its certified accuracy.

A new sensor is one file of data: `from_sheet` for each calibration, `noise_at_rest`, and the
constant ``SENSOR = Sensor(...)``.
"""

import difflib
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from wrenchbed.errors import NotFoundError, ParameterError
from wrenchbed.physics.noise import SATURATED_BITS, Array, NoiseModel, channels

STATUS_OK = 0
"""Status word (uint32) of a row whose six channels are all within their range."""
STATUS_SATURATED = int(SATURATED_BITS.sum())
"""Mask 0x3F of the status word: bit 0 fx, 1 fy, 2 fz, 3 tx, 4 ty, 5 tz is set where it saturates.
Other bits are a device's own and mean nothing here."""


@dataclass(frozen=True, eq=False)
class SensorCalibration:
    """One of the measuring ranges that a sensor is sold with.

    Attributes:
        name: the maker's, for instance ``SI-65-5``: up to 65 N across and 5 N·m.
        range: (6,) full scale ± per channel fx fy fz tx ty tz [N, N·m].
        resolution: (6,) smallest step that the data sheet promises with a 16-bit converter
            [N, N·m]. The step of the output words may be finer: see ``NoiseModel.resolution``.
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
    """A sensor family.

    Attributes:
        name: registry name.
        title: one line for people.
        calibrations: the ranges it is sold with.
        default: name of the one that ``noise`` belongs to.
        mass: of the complete sensor [kg].
        mass_source: where the mass comes from.
        noise: of one row at rest, see ``NoiseModel``.
        noise_source: how it was measured or estimated.
        accuracy: (6,) certified accuracy ± [N, N·m], None where no certificate is known.
        accuracy_source: whose certificate.
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

    def __post_init__(self) -> None:
        self.calibration()
        if self.accuracy is not None:
            object.__setattr__(self, "accuracy", channels(self.accuracy, f"{self.name}.accuracy"))

    def calibration(self, name: str | None = None) -> SensorCalibration:
        """A calibration by its name, the default one if None.

        Raises:
            NotFoundError: no such calibration; the message lists what exists.
        """
        wanted = self.default if name is None else name
        known = {c.name: c for c in self.calibrations}
        if wanted not in known:
            close = difflib.get_close_matches(wanted, known, n=1)
            hint = f"; did you mean {close[0]!r}?" if close else "."
            raise NotFoundError(
                f"{self.name} has no calibration {wanted!r}{hint} Known: {', '.join(known)}"
            )
        return known[wanted]


def axes(across: float, along: float, torque: float) -> Array:
    """Per channel (6,) from a data sheet's three columns Fx,Fy · Fz · Tx,Ty,Tz [N, N, N·m]."""
    return np.array([across, across, along, torque, torque, torque])


def from_sheet(
    name: str,
    full_scale: tuple[float, float, float],
    resolution: tuple[float, float, float],
    source: str,
) -> SensorCalibration:
    """A calibration from a data sheet's three columns: see `axes`."""
    return SensorCalibration(name, axes(*full_scale), axes(*resolution), source)


WARMUP_SHARE, WARMUP_S, AGE_S = 1e-3, 900.0, 3600.0
"""Drift after power-up as a share of full scale, its time constant [s] and the time since power-up
[s]: estimates."""
F_LOW_HZ, F_HIGH_HZ = 1e-3, 100.0
"""Band of the 1/f part [Hz]: estimates; nothing slower than a second was measured."""


def noise_at_rest(
    white: Array, flicker: Array, correlation: Array, full_scale: Array, step: Array
) -> NoiseModel:
    """Noise of one row without mains, of a sensor that was switched on an hour before.

    Args:
        white, flicker: (6,), see `NoiseModel` [N, N·m].
        correlation: (6, 6) of the channels.
        full_scale: (6,) of the calibration [N, N·m].
        step: (6,) of the output words [N, N·m].
    """
    return NoiseModel(
        white=white,
        flicker=flicker,
        f_low=F_LOW_HZ,
        f_high=F_HIGH_HZ,
        correlation=correlation,
        mains_amplitude=np.zeros(6),
        warmup_drift=WARMUP_SHARE * full_scale,
        warmup_time=WARMUP_S,
        warmup_age=AGE_S,
        resolution=step,
        range=full_scale,
    )


def gauge_noise(matrix: ArrayLike) -> tuple[Array, Array]:
    """Standard deviation (6,) and correlation (6, 6) of a wrench read through six equal gauges.

    Args:
        matrix: (6, 6) calibration matrix, wrench = matrix · gauges [N/V, N·m/V]; each gauge is
            taken to carry independent noise of 1 V.
    """
    m = np.asarray(matrix, dtype=np.float64)
    covariance = m @ m.T
    std = np.sqrt(np.diagonal(covariance))
    return std, covariance / np.outer(std, std)
