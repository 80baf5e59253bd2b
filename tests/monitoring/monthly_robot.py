"""One look-alike month by month: the same poses, warm-up, temperature, repeatability, a fault.

Zeros and spans follow the sensor's temperature, which follows the season and the day. Each check
begins some time after the sensor was switched on. Joints come back to a pose within their
repeatability. The noise of rows is the sensor's, with its 1/f part. Ranges are estimates.
"""

from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from functools import cached_property

import numpy as np

import wrenchbed as wb
from wrenchbed.benchmark.fault import log_uniform
from wrenchbed.benchmark.lookalikes.case import DRAWS as FAULTS
from wrenchbed.benchmark.lookalikes.case import LARGEST, background
from wrenchbed.benchmark.lookalikes.experiment_design import ExperimentDesign
from wrenchbed.benchmark.lookalikes.imperfection import Imperfection, ImperfectRobot
from wrenchbed.data.metadata import Metadata, SensorInfo
from wrenchbed.physics.noise import NoiseStream
from wrenchbed.physics.wrench import CHANNELS

FIRST = datetime(2020, 1, 15, 6, tzinfo=UTC)
MONTH_S = 365.25 * 86400.0 / 12.0
ROWS = 200
"""Rows a pose at 100 Hz."""
ZERO_PER_K, SPAN_PER_K = 1e-4, 2e-4
"""Standard deviations of the zeros' [of full scale, 1/K] and the span's [1/K] change by
temperature: 0.1 % of full scale per 10 K, 0.02 %/K."""
SEASON_K, DAY_K = (2.0, 6.0), (0.5, 2.0)
"""Amplitude of the season, and scatter from day to day [K]."""
WARMS_K, READS_K = 0.3, 0.3
"""Change of temperature during a check, error of the recorded one [K], standard deviations."""
ON_S, MOVE_S = (900.0, 14400.0), (3.0, 8.0)
"""Time since the sensor was switched on, and of a move between poses [s]."""
REPEATS = (1e-5, 5e-5)
"""Repeatability of joints, standard deviation [rad or m]."""
LATE_S = 2.0 * 86400.0
"""Largest deviation of a check's time from whole months [s]."""
DRAWS, SCALINGS = 50, 30
"""Most draws of a fault, and most steps to its gap."""


@dataclass(frozen=True, eq=False)
class MonthlyRobot:
    """A robot that is checked month by month; it depends on its arguments alone. ``warm``:
    recordings have the temperature. The effect ``fault`` begins at the month ``begins``, with a
    ``gap``, the mean squared change of readings in units of a row's noise."""

    robot: wb.Robot
    plan: wb.Plan
    seed: int
    warm: bool = True
    fault: str = ""
    begins: int = 0
    gap: float = 1.0

    @cached_property
    def _design(self) -> ExperimentDesign:
        return ExperimentDesign.of_plan(self.plan, self.robot, samples=ROWS)

    @cached_property
    def _readings(self) -> ImperfectRobot:
        return ImperfectRobot(self._design)

    @cached_property
    def _around(self) -> list[tuple[Imperfection, float]]:
        return background(self._readings, np.random.default_rng([self.seed, 1]))

    @cached_property
    def _habits(self) -> dict[str, np.ndarray]:
        """Temperature coefficients of this robot's zero, span and arm."""
        rng = np.random.default_rng([self.seed, 2])
        full = wb.load("sensors", self.robot.sensor).calibration().range
        return {
            "zero": rng.normal(0.0, ZERO_PER_K, 6) * full,
            "span": rng.normal(0.0, SPAN_PER_K, 1),
            "season": rng.uniform(*SEASON_K, 1),
            "phase": rng.uniform(0.0, 2.0 * np.pi, 1),
            "day": rng.uniform(*DAY_K, 1),
            "repeat": rng.uniform(*REPEATS, 1),
        }

    @cached_property
    def cause(self) -> tuple[Imperfection, float] | None:
        """The fault, and how much of it is there; None of a healthy robot.

        Raises:
            ValueError: no draw of plausible size has the gap.
        """
        if not self.fault:
            return None
        rng = np.random.default_rng([self.seed, 3])
        base = self._readings.reading(self._around)
        for _ in range(DRAWS):
            size = log_uniform(rng, 0.5, 4.0)
            item, amount = FAULTS[self.fault](self._design, rng, size), 1.0
            for _ in range(SCALINGS):
                changed = self._readings.reading([*self._around, (item, amount)]) - base
                added = self._design.usual.gap(changed, configured=True)
                if abs(added - self.gap) < 0.01 * self.gap:
                    return item, amount
                amount *= float(np.clip(np.sqrt(self.gap / max(added, 1e-12)), 0.05, 20.0))
                if not amount * size < LARGEST:
                    break
        raise ValueError(f"{self.fault} has no gap of {self.gap:g} on {self.robot.name}")

    def recording(self, month: int) -> wb.Recording:
        """The check of a month (0, 1, …) that states its time."""
        rng = np.random.default_rng([self.seed, 4, month])
        law, n, poses = self._habits, ROWS, len(self.plan)
        when = FIRST + timedelta(seconds=month * MONTH_S + rng.uniform(-LATE_S, LATE_S))
        season = law["season"] * np.sin(2.0 * np.pi * month / 12.0 + law["phase"])
        kelvin = float((season + rng.normal(0.0, law["day"]))[0])
        begin = np.cumsum(rng.uniform(*MOVE_S, poses) + n / 100.0)
        t = (begin[:, None] + np.arange(n) / 100.0).ravel()
        warm = kelvin + rng.normal(0.0, WARMS_K) * (t - t[0]) / (t[-1] - t[0])
        off = rng.normal(0.0, float(law["repeat"][0]), self.plan.q.shape)
        items = [*self._around, (Imperfection(name="repeatability", joint=off), 1.0)]
        if self.cause is not None and month >= self.begins:
            items.append(self.cause)
        load = np.repeat(self._readings.reading(items), n, axis=0)
        load = load * (1.0 + law["span"] * warm[:, None]) + law["zero"] * warm[:, None]
        sensor = wb.load("sensors", self.robot.sensor)
        noise = replace(sensor.noise, warmup_age=float(rng.uniform(*ON_S)))
        rows, _ = NoiseStream(noise, int(rng.integers(2**31))).corrupt(t, load)
        columns = {"t": t, "segment": np.repeat(np.arange(poses), n)}
        q = np.repeat(self.plan.q, n, axis=0)
        columns |= {f"q{j + 1}": q[:, j] for j in range(q.shape[1])}
        columns |= {c: rows[:, k] for k, c in enumerate(CHANNELS)}
        if self.warm:
            columns["temperature"] = np.full(len(t), 20.0 + kelvin + rng.normal(0.0, READS_K))
        metadata = Metadata(
            self.robot.name, "static", "sim", 100.0,
            sensor=SensorInfo(sensor.name, tuple(map(float, noise.row_std))),
            extra={"started": when.isoformat(timespec="milliseconds")},
        )  # fmt: skip
        return wb.Recording(metadata, columns, f"month {month}")
