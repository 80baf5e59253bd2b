"""How old and how even the readings of a live recording were."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from wrenchbed.hardware.drivers.base.samples import ArmSample
from wrenchbed.hardware.transducers.base import WrenchSample

_MOST = 1_000_000
"""Rows that are kept for the percentiles; estimate, some hours."""
_MS = 1e3  # by definition
_PERCENTILES = (50.0, 99.0)  # by definition


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
        found: dict[str, Any] = {"rows": len(self._rows)}
        for name, values in columns.items():
            p50, p99 = np.percentile(values, _PERCENTILES) * _MS
            most = values.max() * _MS
            found[f"{name}_ms"] = {k: round(float(v), 3) for k, v in
                                   (("p50", p50), ("p99", p99), ("max", most))}  # fmt: skip
        return found
