"""How far along its way a move is: constant acceleration, constant speed, constant braking."""

from math import sqrt


class Profile:
    """Trapezoid of speed over a length.

    Args:
        length: of the way.
        speed: highest.
        acceleration: of start and end.
    """

    def __init__(self, length: float, speed: float, acceleration: float) -> None:
        self.length, self._a = length, acceleration
        self._v = min(speed, sqrt(length * acceleration))
        self._ramp = self._v / acceleration
        self.duration = 0.0 if length <= 0.0 else length / self._v + self._ramp

    def at(self, t: float) -> float:
        """Length covered after a time [s]."""
        if t >= self.duration:
            return self.length
        if t < self._ramp:
            return 0.5 * self._a * t * t
        left = self.duration - t
        if left < self._ramp:
            return self.length - 0.5 * self._a * left * left
        return self._v * (t - 0.5 * self._ramp)
