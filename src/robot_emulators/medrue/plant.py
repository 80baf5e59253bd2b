"""The robot behind the drives in real time, with its motors' torques."""

import threading
import time
from collections.abc import Callable, Sequence

import numpy as np

from robot_emulators.base.real_time import CycleThread
from robot_emulators.medrue.drive import DriveEmulator
from robot_emulators.plant import Plant

CYCLE_S = 0.004
_READINGS = 2
"""Readings of the sensor in a cycle, so that its board can be asked at up to 500 Hz."""
_LATE_S = 0.1
"""How far the clock may run behind before it skips [s]; so long, drives wait for targets."""


class RealTimePlant:
    """Steps the robot at 250 Hz towards where the drives' servos want it.

    Args:
        body: the robot, with a control cycle of `CYCLE_S`.
        counts: per unit of each joint (J,).
        lock: shared with the drives.
        failed: called with the error that ended its clock.
    """

    def __init__(
        self, body: Plant, counts: np.ndarray, lock: threading.RLock,
        failed: Callable[[Exception], None],
    ) -> None:  # fmt: skip
        self.body, self.counts = body, counts
        self.drives: Sequence[DriveEmulator] = ()
        self._lock = lock
        self._thread = CycleThread("medrue plant", CYCLE_S, _LATE_S, self._step, failed)
        self._readings: tuple[float, np.ndarray] = (0.0, np.zeros((_READINGS, 6)))

    def wrench(self, t: float) -> np.ndarray:
        """Reading of the sensor at a time [s] of `time.monotonic` (6,)."""
        begun, rows = self._readings
        k = int((t - begun) / CYCLE_S * len(rows))
        return np.asarray(rows[min(max(k, 0), len(rows) - 1)])

    def start(self) -> None:
        """Let time run."""
        self._measure(time.monotonic())
        self._thread.start()

    def stop(self) -> None:
        """Hold the clock; may be called twice."""
        self._thread.stop()

    def _step(self, due: float) -> None:
        t = time.monotonic()
        with self._lock:
            q, qd = self.body.q * self.counts, self.body.qd * self.counts
            torque, current, _ = self.body.efforts
            rows = np.stack([q, qd, torque, current], axis=1).tolist()
            commands = [
                drive.track(t, CYCLE_S, position, speed, effort, due)
                for drive, (position, speed, *effort) in zip(self.drives, rows, strict=True)
            ]
            self.body.step(np.array(commands) / self.counts, due)
        for drive in self.drives:
            drive.tick(t)
        self._measure(due)

    def _measure(self, t: float) -> None:
        times = self.body.time + CYCLE_S * np.arange(_READINGS) / _READINGS
        self._readings = (t, self.body.readings(times)[0])
