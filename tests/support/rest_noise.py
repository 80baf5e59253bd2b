"""Noise of a sensor at rest, drawn in the frequency domain: nothing of it is `NoiseStream`'s code.

A long periodic Gaussian record with the stated density is cut to a part of it, so that the part is
not periodic. It is drawn at 8 times the rate and thinned out, so that the sampling folds the 1/f
part back as it does in a sensor.
"""

from dataclasses import dataclass, field

import numpy as np

from wrenchbed.data.metadata import Metadata, SensorInfo
from wrenchbed.data.recording import Recording
from wrenchbed.physics.wrench import CHANNELS

WHITE = np.array([0.035, 0.02, 0.075, 0.0012, 0.0019, 0.00025])
"""Deviation of one row [N, N·m], much as a Gamma's."""
_FOLDS, _LONGER = 8, 4


@dataclass(frozen=True)
class Rest:
    """A rest to draw: six channels, in units of `WHITE`; no 1/f part, hum, step, drift."""

    seconds: float = 60.0
    rate: float = 250.0
    white: float = 1.0
    flicker: tuple[float, ...] = (0.0,) * 6
    correlation: np.ndarray = field(default_factory=lambda: np.eye(6))
    hum: float = 0.0
    hum_hz: float = 50.03
    step: float = 0.0
    drift: float = 0.0
    """Over a minute."""
    bias: float = 100.0

    def rows(self, seed: int) -> np.ndarray:
        """The wrench (N, 6) [N, N·m]."""
        rng = np.random.default_rng(seed)
        n = round(self.seconds * self.rate)
        t = np.arange(n) / self.rate
        root = np.linalg.cholesky(self.correlation)
        y = rng.normal(size=(n, 6)) * self.white
        y += np.array(self.flicker) * np.stack([pink(rng, n, self.rate) for _ in range(6)], axis=1)
        y = y @ root.T
        y += self.hum * np.sin(2 * np.pi * self.hum_hz * t[:, None] + rng.uniform(0, 6.28, 6))
        y += self.drift * t[:, None] / 60.0 + self.bias * rng.normal(size=6)
        if self.step:
            y = np.rint(y / self.step) * self.step
        return y * WHITE

    def recording(self, seed: int, sensor: str | None = "ati-gamma") -> Recording:
        """Of a UR5 that stands still."""
        return recorded(self.rows(seed), self.rate, sensor)


def recorded(rows: np.ndarray, rate: float, sensor: str | None = "ati-gamma") -> Recording:
    """A recording of rows (N, 6) while a UR5 stands still."""
    n = len(rows)
    columns = {"t": np.arange(n) / rate} | {f"q{k}": np.full(n, 0.1 * k) for k in range(1, 7)}
    columns |= dict(zip(CHANNELS, rows.T, strict=True))
    return Recording(Metadata("ur5", "static", sensor=SensorInfo(sensor)), columns, "rest.parquet")


def pink(rng: np.random.Generator, n: int, rate: float) -> np.ndarray:
    """1/f noise (n,) with a density's root of 1 at 1 Hz, between 1 mHz and 100 Hz."""
    fine, count = rate * _FOLDS, n * _FOLDS * _LONGER
    f = np.fft.rfftfreq(count, 1.0 / fine)
    f[0] = f[1]
    density = (np.arctan(100.0 / f) - np.arctan(1e-3 / f)) * 2.0 / (np.pi * f)
    waves = rng.normal(size=len(f)) + 1j * rng.normal(size=len(f))
    long = np.fft.irfft(waves * np.sqrt(density * fine * count / 4.0), count)
    first = int(rng.integers(0, count - n * _FOLDS))
    return np.asarray(long[first : first + n * _FOLDS : _FOLDS])
