"""A sensor's noise from a recording at rest: white and 1/f part, correlation, mains, drift, step.

Vibration that the robot adds at rest cannot be separated from the sensor: it is in the figures, and
spectral lines that stand out are named.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from wrenchbed import registry
from wrenchbed.calibration.noise_spectrum import Clock, Spectrum, fit
from wrenchbed.calibration.sensor_rest_check import check_rest
from wrenchbed.data.recording import Recording
from wrenchbed.errors import CalibrationError
from wrenchbed.files import write_text
from wrenchbed.physics.noise import NoiseModel
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.sensors.base import Sensor, SensorCalibration
from wrenchbed.sensors.described import text

UNKNOWN_SENSOR = "generic"
"""Name of the sensor that gives range, resolution and mass where a recording names none."""
_BAND = NoiseModel()
MAINS_HZ = (50.0, 60.0)
_MAINS_OFF_HZ = 0.2
"""Largest deviation of mains frequency [Hz]: continental Europe's grid sheds load at 49.8 Hz."""
_BESIDE_HZ = (2.5, 8.5)
"""Distance range of the frequencies that a mains line is compared with [Hz]."""
_LEAST_RATE = 2.4
"""Least ratio of the row rate to a mains frequency at which the line is looked for."""
_CHANCE = 1e-3
"""Probability of a line or a drift in noise alone, all channels and frequencies together."""
_COARSE = 0.5
"""Standard deviation of a row, in steps of the output, above which rounding errors are white."""
_LARGEST_MULTIPLE, _OFF_GRID, _LEAST_LEVELS = 12, 0.02, 3
"""Search for the step of an output's grid: most steps in the smallest difference of two values,
largest distance of a value from the grid in steps, and fewest different values that show a grid."""
_MOST_LINES = 6


@dataclass(frozen=True, eq=False)
class LearnedSensor:
    """Sensor data whose noise was fitted to a recording at rest.

    Attributes:
        sensor: the sensor; range, resolution, mass and plate offset are those of ``like``.
        like: name of the sensor that served as template.
        rest: noise of the recording, with its uncertainties.
    """

    sensor: Sensor
    like: str
    rest: "RestNoise"
    cannot_tell: tuple[str, ...]

    @property
    def text(self) -> str:
        """Contents of the sensor's TOML file."""
        return text(self.sensor, (self.sensor.title, "", *self.cannot_tell))

    def write(self, path: str | Path) -> None:
        """Write the sensor's TOML file, whose path can be given wherever a sensor's name can."""
        write_text(Path(path), self.text)


def learn_sensor(
    recording: Recording, *, name: str | None = None, like: str | None = None
) -> LearnedSensor:
    """Learn a sensor's noise from a recording at rest, a minute or more at the usual rate.

    Args:
        recording: one pose, an even clock, nothing touches the tool.
        name: name of the new sensor; default is the recording's file name.
        like: registry name or TOML file of the sensor that range, resolution, mass and plate offset
            are taken from; default is what the recording states, else ``generic``.

    Raises:
        CalibrationError: too short, moving, uneven, saturated, disturbed, dead, or out of range.
        NotFoundError: there is no sensor ``like``.
    """
    rate = check_rest(recording)
    stated = recording.metadata.sensor.model
    if like is None:
        known = stated is not None and registry.is_known("sensors", stated)
        like = str(stated) if known else UNKNOWN_SENSOR
    base: Sensor = registry.load("sensors", like)
    rows = np.asarray(recording.wrench, dtype=np.float64)
    calibration = _within_range(rows, base, recording.name)
    clock = Clock(len(rows), rate, _BAND.f_low, _BAND.f_high)
    rest = RestNoise(rows, clock)
    steps = np.array([grid_step(column) for column in rows.T])
    white = np.sqrt(np.maximum([s.white**2 for s in rest.spectra] - steps**2 / 12.0, 0.0))
    sure = np.abs(rest.drift) > _sigmas(6) * rest.drift_std
    noise = NoiseModel(
        white=white,
        flicker=np.array([s.flicker for s in rest.spectra]),
        f_low=_BAND.f_low, f_high=_BAND.f_high,
        correlation=rest.correlation,
        mains_amplitude=rest.mains, mains_frequency=rest.mains_hz,
        warmup_drift=np.where(sure, rest.drift * _BAND.warmup_time, 0.0),
        warmup_time=_BAND.warmup_time, warmup_age=0.0,
        resolution=steps, range=calibration.range,
    )  # fmt: skip
    name = name or Path(recording.name).stem or "mine"
    length = f"{len(rows):,} rows at {rate:.4g} Hz, {clock.rows / rate:.3g} s"
    learnt = f"learnt by wrenchbed from {Path(recording.name).name}, {length} at rest"
    sensor = replace(
        base, name=name.replace("@", "-"), title=f"{name}: noise {learnt}",
        default=calibration.name, noise=noise, record=None,
        noise_source=f"{learnt}; {_figures(rest, white)}",
        calibrations=tuple(
            replace(c, source=_taken(c.source, like)) for c in base.calibrations
        ),
        mass_source=_taken(base.mass_source, like),
        plate_offset_source=_taken(base.plate_offset_source, like),
    )  # fmt: skip
    unknown = tuple(_cannot_tell(rest, steps, like, sure))
    return LearnedSensor(sensor, like, rest, unknown)


def _within_range(rows: np.ndarray, base: Sensor, name: str) -> SensorCalibration:
    """Calibration of ``base`` whose range contains rows (N, 6): its default one, else the first. A
    `CalibrationError`, which begins with ``name``, if there is none."""
    most = np.abs(rows).max(axis=0)
    for calibration in (base.calibration(), *base.calibrations):
        if (most < calibration.range).all():
            return calibration
    full = np.max([c.range for c in base.calibrations], axis=0)
    worst = int(np.argmax(most / full))
    raise CalibrationError(
        f"{name}: column {CHANNELS[worst]!r} reads {most[worst]:.4g}, beyond the range "
        f"{full[worst]:g} of {base.name}: state the right sensor by --like"
    )


def _taken(source: str, like: str) -> str:
    return source if source.startswith("taken from ") else f"taken from {like}: {source}"


def _figures(rest: "RestNoise", white: np.ndarray) -> str:
    """Text of noise figures with uncertainties, for ``source`` in the sensor's TOML file; ``white``
    (6,): standard deviations of white noise [N, N·m]."""
    parts = [
        f"{c} {w:.3g} ± {s.white_std:.1g}, 1/f "
        + (f"{s.flicker:.3g} ± {s.flicker_std:.1g}" if s.flicker else f"< {s.flicker_most:.2g}")
        for c, w, s in zip(CHANNELS, white, rest.spectra, strict=True)
    ]
    return "white " + "; ".join(parts)


class RestNoise:
    """Noise of a recording at rest, by periodograms of its channels fx fy fz tx ty tz [N, N·m].

    Attributes:
        rows, rate: number of rows of the recording and their rate [Hz].
        spectra: white and 1/f part of each channel, with uncertainties.
        row_std: standard deviation of a row (6,), without the drift where one is significant.
        drift, drift_std: slope over the recording and its standard uncertainty (6,) [N/s, N·m/s].
        mains, mains_std, mains_hz: amplitudes (6,) of the mains line, 0 where none stands out,
            their standard uncertainty, and its frequency [Hz].
        correlation, correlation_std: of the channels (6, 6), and its standard uncertainty.
        lines: frequencies [Hz] of other lines in any channel, strongest first; in the white noise.
    """

    def __init__(self, rows: np.ndarray, clock: Clock) -> None:
        self.rows, self.rate = clock.rows, clock.rate
        self._clock = clock
        t = (np.arange(clock.rows) - (clock.rows - 1) / 2.0) / clock.rate
        self.drift = np.asarray(t @ rows / (t @ t))
        level = rows - rows.mean(axis=0)
        straight = level - t[:, None] * self.drift
        low = clock.frequency < 2.5 * clock.rate / clock.rows  # what taking a slope off changes
        calm = ~_near_mains(clock) & ~low
        fits = [fit(clock.periodogram(c), calm, clock) for c in straight.T]
        self.drift_std = _slope_std(fits, clock)
        drifting = (np.abs(self.drift) > _sigmas(6) * self.drift_std).any()
        self._rows = straight if drifting else level
        self.row_std = self._rows.std(axis=0)
        if not drifting:
            calm |= low
            fits = [fit(clock.periodogram(c), calm, clock) for c in level.T]
            self.drift_std = _slope_std(fits, clock)
        self.spectra = tuple(fits)
        self._density = np.stack([s.density(clock) for s in fits])
        self._spectrum = np.fft.rfft(self._rows, axis=0)[1 : len(clock.frequency) + 1].T
        self._mains()
        self._correlate(calm)
        self.lines = self._lines()

    def _mains(self) -> None:
        """Find one mains frequency near 50 or 60 Hz, and set each channel's amplitude there."""
        clock = self._clock
        best, self.mains_hz = 0.0, MAINS_HZ[0]
        self.mains, self.mains_std = np.zeros(6), np.full(6, np.nan)
        seen = 2.0 / (clock.rate * clock.rows) * np.abs(self._spectrum) ** 2
        t = np.arange(clock.rows) / clock.rate
        count = max(1, math.ceil(_MAINS_OFF_HZ * 4.0 * clock.rows / clock.rate))
        tries = 6 * len(MAINS_HZ) * (2 * count + 1)
        for mains in seen_mains(clock.rate):
            off = np.abs(clock.frequency - mains)
            beside = (off >= _BESIDE_HZ[0]) & (off <= _BESIDE_HZ[1])
            density, count_beside = seen[:, beside].mean(axis=1), int(beside.sum())
            std = np.sqrt(density * clock.rate / clock.rows)
            if mains == MAINS_HZ[0] or not best:
                self.mains_std = std
            for offset in np.linspace(-_MAINS_OFF_HZ, _MAINS_OFF_HZ, 2 * count + 1):
                wave = np.exp(-2j * np.pi * (mains + offset) * t)
                sums = np.abs(wave @ self._rows)
                power = 2.0 / (clock.rate * clock.rows) * sums**2 / density
                chance = (1.0 + power / count_beside) ** -count_beside
                if chance.min() < _CHANCE / tries and power.sum() > best:
                    best, self.mains_hz = float(power.sum()), float(mains + offset)
                    amplitude = 2.0 / clock.rows * sums
                    known = np.sqrt(np.maximum(amplitude**2 - 2.0 * std**2, 0.0))
                    self.mains = np.where(chance < _CHANCE / 6, known, 0.0)
                    self.mains_std = std

    def _correlate(self, calm: np.ndarray) -> None:
        white = self._spectrum[:, calm] / np.sqrt(self._density[:, calm])
        shared = (white @ white.conj().T).real
        size = np.sqrt(np.diagonal(shared))
        correlation = shared / np.outer(size, size)
        np.fill_diagonal(correlation, 1.0)
        self.correlation = 0.5 * (correlation + correlation.T)
        self.correlation_std = 1.0 / math.sqrt(2.0 * calm.sum())

    def _lines(self) -> tuple[float, ...]:
        clock = self._clock
        power = 2.0 / (clock.rate * clock.rows) * np.abs(self._spectrum) ** 2 / self._density
        strongest = power.max(axis=0)
        width = 2.0 * clock.rate / clock.rows
        if self.mains.any():
            strongest[np.abs(clock.frequency - self.mains_hz) <= 2.0 * width] = 0.0
        lines: list[float] = []
        while len(lines) < _MOST_LINES:
            at = int(np.argmax(strongest))
            if strongest[at] < math.log(power.size / _CHANCE):
                break
            lines.append(float(clock.frequency[at]))
            strongest[np.abs(clock.frequency - lines[-1]) <= max(width, 0.05 * lines[-1])] = 0.0
        return tuple(lines)


def _slope_std(fits: list[Spectrum], clock: Clock) -> np.ndarray:
    """Standard uncertainty (6,) of the channels' drifts, due to their noise; where no 1/f noise is
    significant, its upper limit counts."""
    return np.array([clock.slope_std(s.white, s.flicker or s.flicker_most) for s in fits])


def seen_mains(rate: float) -> tuple[float, ...]:
    """Mains frequencies [Hz] that rows at a rate [Hz] resolve without aliasing."""
    return tuple(f for f in MAINS_HZ if rate > _LEAST_RATE * f)


def _near_mains(clock: Clock) -> np.ndarray:
    """Booleans (K,): Fourier frequencies near the mains frequency or a multiple of it."""
    f = clock.frequency
    width = max(0.5, 2.0 * clock.rate / clock.rows)
    near = np.zeros(len(f), dtype=bool)
    for mains in seen_mains(clock.rate):
        near |= (np.abs(f - mains * np.maximum(np.rint(f / mains), 1.0)) < width) & (f > mains / 2)
    return near


def _sigmas(tries: int) -> float:
    """Bound [σ] that the largest of ``tries`` normal numbers exceeds with probability `_CHANCE`."""
    from scipy.special import ndtri

    return float(-ndtri(_CHANCE / (2 * tries)))


def grid_step(rows: np.ndarray) -> float:
    """Step of the grid (counts of a converter) on which all values (N,) lie; 0 without one."""
    levels = np.unique(rows)
    if len(levels) < _LEAST_LEVELS:
        return float(np.ptp(levels))
    gaps = np.diff(levels)
    rounding = 8.0 * float(np.spacing(np.abs(levels).max()))
    gaps = gaps[gaps > rounding]
    if len(gaps) < _LEAST_LEVELS - 1:
        return 0.0
    for part in range(1, _LARGEST_MULTIPLE + 1):
        step = _refined(np.sort(gaps), float(gaps.min()) / part)
        off = np.abs(gaps / step - np.rint(gaps / step))
        if off.max() <= _OFF_GRID and rounding < _OFF_GRID * step:
            return float(f"{step:.6g}")
    return 0.0


def _refined(gaps: np.ndarray, step: float) -> float:
    """Refine a grid's rough ``step`` by ``gaps`` (N,), ascending multiples of it between values."""
    for count in (len(gaps) // 4, len(gaps) // 2, len(gaps)):
        some = gaps[: max(count, 1)]
        times = np.rint(some / step)
        step = float(times @ some / (times @ times))
    return step


def _cannot_tell(
    rest: RestNoise, steps: np.ndarray, like: str, drifting: np.ndarray
) -> Iterator[str]:
    seconds = rest.rows / rest.rate
    yield f"What is slower than {seconds:.3g} s: that the 1/f part goes on is an assumption."
    yield "What the robot adds at rest: vibration is in these numbers."
    yield f"Range, resolution, mass and plate offset: they are those of {like}."
    if rest.lines:
        said = ", ".join(f"{f:.3g}" for f in sorted(rest.lines))
        yield f"Lines at {said} Hz (robot, room): they are counted as white noise."
    odd = [c for c, s in zip(CHANNELS, rest.spectra, strict=True) if not s.follows]
    if odd:
        yield (
            f"The colour of {', '.join(odd)}: it is not white and 1/f. The deviation of a row is "
            "kept as white noise; 1/f is what is below 2 Hz."
        )
    low = [c for c, s in zip(CHANNELS, rest.spectra, strict=True) if not s.flicker]
    if low:
        yield f"The 1/f part of {', '.join(low)}: it is not significant above the white noise."
    coarse = [
        c for c, std, step in zip(CHANNELS, rest.row_std, steps, strict=True)
        if std < _COARSE * step
    ]  # fmt: skip
    if coarse:
        yield f"The noise of {', '.join(coarse)}: it is below the step of the output."
    unseen = [f for f in MAINS_HZ if f not in seen_mains(rest.rate)]
    if unseen:
        said = " and ".join(f"{f:g}" for f in unseen)
        yield f"A mains line of {said} Hz: the rate of {rest.rate:.4g} Hz is too low."
    if drifting.any():
        yield (
            "How long the drift goes on: its time constant of 15 min is an estimate; record again "
            "when the sensor is warm."
        )
