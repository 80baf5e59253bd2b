"""Times of a live recording: rows at equal steps of the robot's clock, and how even they came.

A network delivers states unevenly and drops some, but each carries the robot's time. Between two
states joints follow the cubic that has their values and speeds (Hermite); the wrench is read at
the same moment of this machine's clock, to which the robot's is fitted.
"""

import bisect
from collections import deque
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from wrenchbed.errors import LinkError
from wrenchbed.hardware.device import STALE_S, ClockFit
from wrenchbed.hardware.drivers.base import ArmSample
from wrenchbed.hardware.transducers.base import WrenchSample

_LATEST = 64
"""States that are kept to interpolate between: half a second at 125 Hz, more than rows wait."""
_STRETCH_S = 0.4
"""Stretch of which the least late state counts for the clocks [s]: among 50 of 125 Hz one is on
time."""
_MOST = 1_000_000
"""Rows that are kept for the percentiles: two hours at 125 Hz, 24 MB."""


class EvenRow(NamedTuple):
    """One row: even time [s], the same moment on this machine's clock, joints and speeds (J,), and
    the robot's evidence, linear between two states."""

    t: float
    host: float
    q: np.ndarray
    qd: np.ndarray
    evidence: Mapping[str, np.ndarray]


class Resampler:
    """Turns states into rows at a rate [Hz], from the first state on."""

    def __init__(self, rate: float) -> None:
        self._period = 1.0 / rate
        self._states: deque[ArmSample] = deque(maxlen=_LATEST)
        self._times: deque[float] = deque(maxlen=_LATEST)
        self._clock = ClockFit(_STRETCH_S)
        self._first: float | None = None
        self._origin = 0.0
        self._count = 0

    def add(self, arm: ArmSample) -> None:
        """Take in a state; one that is not newer than the last is left out."""
        t = controller_time(arm)
        if self._states and t <= controller_time(self._states[-1]):
            return
        if self._first is None:
            self._first, self._origin = t, arm.t
        self._states.append(arm)
        self._times.append(t - self._first)
        self._clock.add(t - self._first, arm.t - self._origin)

    def rows(self, most: int) -> list[EvenRow]:
        """The next rows that lie between states, at most ``most``.

        Raises:
            LinkError: two states are too far apart to interpolate.
        """
        rows: list[EvenRow] = []
        while len(rows) < most and (row := self._next()) is not None:
            rows.append(row)
        return rows

    def _next(self) -> EvenRow | None:
        if self._first is None:
            return None
        due = self._count * self._period
        times = list(self._times)
        if due > times[-1] + 1e-9 or len(times) < 2:
            return None
        k = min(max(bisect.bisect_left(times, due + 1e-9), 1), len(times) - 1)
        before, after = self._states[k - 1], self._states[k]
        span = times[k] - times[k - 1]
        if span > STALE_S and due > times[k - 1] + 1e-9:
            raise LinkError(f"the robot's states have a gap of {span:.3f} s in the motion")
        self._count += 1
        fraction = float(np.clip((due - times[k - 1]) / span, 0.0, 1.0))
        q, qd = hermite(before, after, span, fraction)
        evidence = {
            name: value + fraction * (after.evidence[name] - value)
            for name, value in before.evidence.items()
        }
        host = self._origin + self._clock.host(due)
        return EvenRow(self._origin + due, host, q, qd, evidence)


def controller_time(arm: ArmSample) -> float:
    """Time of a robot's state [s]: on the robot's clock, or on this machine's if it has none."""
    return arm.t if arm.device_time is None else arm.device_time


def hermite(
    before: ArmSample, after: ArmSample, span: float, s: float
) -> tuple[np.ndarray, np.ndarray]:
    """Joint values and speeds (J,) at a fraction of the time [s] between two states."""
    h00, h10 = (1 + 2 * s) * (1 - s) ** 2, s * (1 - s) ** 2
    h01, h11 = s * s * (3 - 2 * s), s * s * (s - 1)
    q = h00 * before.q + h01 * after.q + span * (h10 * before.qd + h11 * after.qd)
    slope = (6 * s * s - 6 * s) / span
    rate_in, rate_out = (1 - s) * (1 - 3 * s), s * (3 * s - 2)
    qd = slope * (before.q - after.q) + rate_in * before.qd + rate_out * after.qd
    return q, qd


class Timing:
    """Ages and jitter of the rows of a recording."""

    def __init__(self) -> None:
        self._rows: list[tuple[float, float, float]] = []
        self._steps: list[float] = []
        self._last: tuple[float, float] | None = None

    def add(self, arm: ArmSample, wrench: WrenchSample) -> None:
        """Take in the state and the reading of a row."""
        if len(self._rows) >= _MOST:
            return
        self._rows.append((arm.age, wrench.age, abs(arm.t - wrench.t)))
        if arm.device_time is None:
            return
        before, self._last = self._last, (arm.t, arm.device_time)
        if before is not None and 0.0 < arm.device_time - before[1] < 1.0:
            self._steps.append(abs((arm.t - before[0]) - (arm.device_time - before[1])))

    def summary(self) -> Mapping[str, Any]:
        """Rows, and the median, 99th percentile and maximum of each quantity [ms].

        ``robot_age`` and ``sensor_age``: from arrival to use. ``apart``: between the two arrivals
        of a row. ``jitter``: of the robot's states, their arrival against the robot's own clock.
        """
        if not self._rows:
            return {}
        names = ("robot_age", "sensor_age", "apart")
        columns = dict(zip(names, np.transpose(self._rows), strict=True))
        if self._steps:
            columns["jitter"] = np.array(self._steps)
        summary: dict[str, Any] = {"rows": len(self._rows)}
        for name, values in columns.items():
            figures = zip(("p50", "p99", "max"), np.percentile(values, (50, 99, 100)), strict=True)
            summary[f"{name}_ms"] = {k: round(1e3 * float(v), 3) for k, v in figures}
        return summary
