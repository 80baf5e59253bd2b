"""Speed of a move, and whether streamed targets arrive."""

from collections import deque

import numpy as np

_LEAST_SPEED, _LEAST_ACCELERATION, _MOST_ACCELERATION = 0.01, 0.05, 15.0
_WINDOW_S, _LAG_S = 0.6, 0.2
_MOVED, _SHARE = 0.02, 0.2
_EVERY = 8


def trapezoid(distance: float, seconds: float, top: float) -> tuple[float, float]:
    """Peak speed [rad/s] and acceleration [rad/s²] of a move over a distance [rad] in a time [s].

    A third of the time speeds up and a third slows down, unless that needs more than ``top``
    [rad/s] or 15 rad/s²; then the move takes longer.
    """
    speed = min(1.5 * distance / seconds, top)
    acceleration = 3.0 * speed / seconds
    return (
        max(speed, _LEAST_SPEED),
        min(max(acceleration, _LEAST_ACCELERATION), _MOST_ACCELERATION),
    )


class Followed:
    """Whether the controller's own targets follow those that were sent.

    ur_rtde says yes to targets that it drops; the controller's ``target_q`` does not.
    """

    def __init__(self) -> None:
        self._seen: deque[tuple[float, np.ndarray, np.ndarray]] = deque(maxlen=400)
        self._count = 0

    def clear(self) -> None:
        """A stream begins anew."""
        self._seen.clear()

    def add(self, t: float, sent: np.ndarray, target: np.ndarray) -> str:
        """Take in a target (J,) that was sent and the controller's own (J,); why not, if not."""
        if self._seen and t - self._seen[-1][0] > _LAG_S:
            self._seen.clear()
        self._seen.append((t, sent, target))
        while t - self._seen[0][0] > _WINDOW_S:
            self._seen.popleft()
        self._count += 1
        if self._count % _EVERY or t - self._seen[0][0] < 2.0 * _LAG_S:
            return ""
        old = np.array([s for then, s, _ in self._seen if t - then > _LAG_S])
        moved = np.ptp(old, axis=0)
        followed = np.ptp(np.array([a for _, _, a in self._seen]), axis=0)
        joint = int(np.argmax(moved))
        if moved[joint] > _MOVED and followed[joint] < _SHARE * moved[joint]:
            return "targets are sent and the controller does not follow them: call recover()"
        return ""
