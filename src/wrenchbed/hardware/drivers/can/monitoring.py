"""Do the drives follow their targets, and do the axes stand still?

A drive monitors its own following error, but cannot detect an encoder that froze; the master does.
No voltage is taken off an axis that moves.
"""

import time
from typing import NamedTuple

import numpy as np

from wrenchbed.hardware.device import STALE_S


class CycleAnswers(NamedTuple):
    """Answers of all drives to one SYNC.

    Attributes:
        t: when SYNC was sent [s].
        q: positions (J,) in units of the joints.
        qd: speeds (J,) in units of the joints.
        torque: thousandths of the rated torque (J,).
        sequence: number of such answers.
    """

    t: float
    q: np.ndarray
    qd: np.ndarray
    torque: np.ndarray
    sequence: int


STUCK_S = 0.01
"""A target may move this long at top speed while the position stays [s]; estimate."""
FAR_S = 0.15
"""Farthest that a position may be behind its target, likewise [s]; estimate."""


class Following:
    """Compares positions with targets, cycle by cycle.

    Args:
        speed: top speed of each joint (J,).
    """

    def __init__(self, speed: np.ndarray) -> None:
        self._stuck, self._far = STUCK_S * speed, FAR_S * speed
        self._last: np.ndarray | None = None
        self._reference = np.zeros(len(speed))

    def forget(self) -> None:
        """Start a new comparison."""
        self._last = None

    def check(
        self, counts: np.ndarray, q: np.ndarray, target: np.ndarray
    ) -> tuple[int, str] | None:
        """The first joint that does not follow, and a description; None if all follow.

        Args:
            counts: positions as reported by the drives (J,).
            q: the same in units of the joints (J,).
            target: commanded joint values (J,).
        """
        if self._last is None:
            self._last, self._reference = counts, np.array(target)
            return None
        moved = counts != self._last
        self._reference[moved] = target[moved]
        self._last = counts
        for joint in np.flatnonzero(np.abs(target - self._reference) > self._stuck)[:1]:
            moved_by = float(abs(target[joint] - self._reference[joint]))
            return int(joint), f"stands still while its target moved by {moved_by:.2g}"
        for joint in np.flatnonzero(np.abs(target - q) > self._far)[:1]:
            return int(joint), f"is {float(abs(target[joint] - q[joint])):.2g} off its target"
        return None


REST_S = 0.5
"""Longest duration of a quick stop from top speed [s]; estimate."""
_SHARE = 0.02
"""Share of top speed below which an axis stands still; estimate."""
_ENOUGH = 6
"""Answers from which a speed is computed; estimate."""
_COUNTS = 0.3
"""Apparent speed of an axis at rest whose encoder flickers [count a cycle]; estimate."""


class Rest:
    """Whether the axes stand still, by the drives' newest answers.

    Args:
        speed: top speed of each joint (J,).
        counts: per unit of each joint (J,).
        period: of the cycles [s].
        watchdog: silence after which drives stop [s].
    """

    def __init__(
        self, speed: np.ndarray, counts: np.ndarray, period: float, watchdog: float
    ) -> None:
        self._slow = _SHARE * speed + _COUNTS / (np.abs(counts) * period)
        self.longest = watchdog + REST_S
        """Silence after which every drive has stopped by its watchdog [s]."""

    def moving(self, answers: CycleAnswers | None) -> np.ndarray:
        """Which joints move (J,), by their newest answers."""
        return (
            np.zeros(len(self._slow), bool) if answers is None else np.abs(answers.qd) > self._slow
        )

    def reached(self, answers: CycleAnswers | None) -> bool:
        """Whether all stand still: by their answers, or by a silence in which all have stopped."""
        if answers is None:
            return True
        age = time.monotonic() - answers.t
        if age >= STALE_S:
            return age > self.longest
        return answers.sequence >= _ENOUGH and not self.moving(answers).any()
