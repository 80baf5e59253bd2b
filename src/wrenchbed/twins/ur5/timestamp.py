"""The controller's own clock, as RTDE states it."""

import time

from wrenchbed.serving.body import Body


class Timestamp:
    """Seconds since the controller was switched on: the robot's simulated time, with its errors."""

    def __init__(self, body: Body) -> None:
        self._body = body
        self._offset = -body.time
        self._scale, self._scale_until, self._scale_from = 1.0, 0.0, 0.0

    def now(self) -> float:
        """Time stamp of the newest state [s]."""
        if self._scale != 1.0 and time.monotonic() >= self._scale_until:
            self.scale(1.0, float("inf"))
        return self._offset + self._body.time + self._gain()

    def jump(self, by: float) -> None:
        """Move the clock [s]."""
        self._offset += by

    def lost(self, seconds: float) -> None:
        """Count time in which the loop stood still [s]."""
        self._offset += seconds

    def scale(self, factor: float, until: float) -> None:
        """Let the clock run faster or slower until a time of `time.monotonic` [s]."""
        self._offset += self._gain()
        self._scale, self._scale_until, self._scale_from = factor, until, self._body.time

    def restart(self, at: float) -> None:
        """Begin near zero at a time of `time.monotonic` [s]."""
        self._scale = 1.0
        left = max(0.0, at - time.monotonic())
        self._offset = -self._body.time - (left if left != float("inf") else 0.0)

    def _gain(self) -> float:
        return (self._scale - 1.0) * (self._body.time - self._scale_from)
