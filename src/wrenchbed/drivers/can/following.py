"""Whether drives go where they are told, as the master sees it.

A drive watches its own following error; one whose encoder froze does not see any.
"""

import numpy as np

STUCK_S = 0.01
"""A target may move as far as top speed takes it in this time while the position stays [s]."""
FAR_S = 0.15
"""Farthest that a position may be behind its target, likewise [s]."""


class Following:
    """Positions beside targets, cycle by cycle.

    Args:
        speed: top speed of each joint (J,).
    """

    def __init__(self, speed: np.ndarray) -> None:
        self._stuck, self._far = STUCK_S * speed, FAR_S * speed
        self._last: np.ndarray | None = None
        self._told = np.zeros(len(speed))

    def forget(self) -> None:
        """Begin anew."""
        self._last = None

    def check(
        self, counts: np.ndarray, q: np.ndarray, target: np.ndarray
    ) -> tuple[int, str] | None:
        """The first joint that does not follow, and how.

        Args:
            counts: positions as the drives tell them (J,).
            q: the same in units of the joints (J,).
            target: what they were told (J,).
        """
        if self._last is None:
            self._last, self._told = counts, np.array(target)
            return None
        moved = counts != self._last
        self._told[moved] = target[moved]
        self._last = counts
        for joint in np.flatnonzero(np.abs(target - self._told) > self._stuck)[:1]:
            way = float(abs(target[joint] - self._told[joint]))
            return int(joint), f"stands still while its target moved by {way:.2g}"
        for joint in np.flatnonzero(np.abs(target - q) > self._far)[:1]:
            return int(joint), f"is {float(abs(target[joint] - q[joint])):.2g} off its target"
        return None
