"""One drive's axis in counts: the CiA 402 state machine and the set-point generator.

`control` takes the controlword, `sync` the target of cyclic synchronous position mode, `advance`
the time. A fault or a quick stop decelerates the axis on its quick-stop ramp; then the brake
holds it.
"""

import enum
import math
from dataclasses import dataclass


class AxisState(enum.Enum):
    """State of the power drive system; the value is its part of the statusword."""

    DISABLED = 0x40
    READY = 0x21
    SWITCHED_ON = 0x23
    ENABLED = 0x27
    QUICK_STOP = 0x07
    FAULT = 0x08


FOLLOWING_ERROR = 0x8611
RPDO_TIMEOUT = 0x8250
SYNC_ERROR = 0x8700
PROFILE, CYCLIC = 1, 8
_VOLTAGE, _WARNING, _REMOTE = 1 << 4, 1 << 7, 1 << 9
_REACHED, _LIMITED, _BIT12, _BIT13 = 1 << 10, 1 << 11, 1 << 12, 1 << 13
_LIMIT_MARGIN = 1


@dataclass(frozen=True)
class Ratings:
    """What an axis can do.

    Attributes:
        lower: software position limit [count].
        upper: likewise.
        window: largest following error [count].
        quick: quick-stop deceleration [count/s²].
        speed: profile speed [count/s].
        acceleration: profile acceleration [count/s²].
        torque: rated, of its motor [N·m, or N].
    """

    lower: int
    upper: int
    window: int
    quick: float
    speed: float
    acceleration: float
    torque: float


class Axis:
    """One drive without its bus."""

    def __init__(self, ratings: Ratings, position: float) -> None:
        self.ratings = ratings
        self.lower, self.upper, self.window = ratings.lower, ratings.upper, ratings.window
        self.actual = self.command = position
        self.state = AxisState.DISABLED
        self.mode = CYCLIC
        self.code = 0
        self.raised: list[int] = []
        """Error codes that were not reported yet; 0: the error is gone."""
        self._speed = 0.0
        self._word = 0
        self._segment: tuple[float, float, float, float] | None = None
        self._goal: float | None = None
        self._limited = self._acknowledged = False

    @property
    def statusword(self) -> int:
        """0x6041."""
        word = self.state.value | _VOLTAGE | _REMOTE
        if self.code and self.state is not AxisState.FAULT:
            word |= _WARNING
        if self._limited:
            word |= _LIMITED
        if self.state is AxisState.ENABLED and self.mode == CYCLIC:
            word |= _BIT12
        if self.state is AxisState.ENABLED and self.mode == PROFILE:
            word |= _REACHED * (self._goal is None) | _BIT12 * self._acknowledged
        if self.code == FOLLOWING_ERROR:
            word |= _BIT13
        return word

    @property
    def driven(self) -> bool:
        """Whether it follows targets."""
        return self.state is AxisState.ENABLED

    def control(self, word: int) -> None:
        """Take a controlword (0x6040)."""
        rising, self._word = word & ~self._word, word
        if self.state is AxisState.FAULT:
            if rising & 0x80 and self._speed == 0.0:
                self._clear()
                self.state = AxisState.DISABLED
        elif not word & 0x02:
            self._leave(AxisState.DISABLED)
        elif not word & 0x04:
            if self.state is AxisState.ENABLED:
                self._leave(AxisState.QUICK_STOP)
            elif self.state is not AxisState.QUICK_STOP:
                self._leave(AxisState.DISABLED)
        elif self.state is not AxisState.QUICK_STOP:
            self._go_up(word)
        if self.driven and self.mode == PROFILE:
            self._acknowledged = bool(word & 0x10)

    def new_goal(self, target: float) -> None:
        """A set-point of profile position mode, at the rising edge of controlword's bit 4."""
        if self.driven and self.mode == PROFILE:
            self._goal = self._within(target)

    def sync(self, t: float, target: float, period: float) -> None:
        """Take a target of cyclic synchronous position mode, to be reached in a period [s]."""
        if not self.driven or self.mode != CYCLIC:
            return
        target = self._within(target)
        if abs(target - self.actual) > self.window:
            self.fault(FOLLOWING_ERROR)
            return
        self._segment = (t, self.command, target, period)

    def advance(self, t: float, seconds: float, actual: float) -> float:
        """Where the servo shall be after some time [s]; ``actual`` is where it is [count]."""
        self.actual = actual
        before = self.command
        if not self.driven:
            self._brake(seconds)
            return self.command
        if self.mode == CYCLIC and self._segment is not None:
            begun, start, end, period = self._segment
            share = min(1.0, max(0.0, (t - begun) / period)) if period > 0.0 else 1.0
            self.command = start + share * (end - start)
            self._speed = (self.command - before) / seconds
        elif self.mode == PROFILE:
            self._profile(seconds)
        if abs(self.command - actual) > self.window:
            self.fault(FOLLOWING_ERROR)
        return self.command

    def fault(self, code: int) -> None:
        """Go to FAULT with an error code (0x603F)."""
        if self.state is not AxisState.FAULT:
            self._leave(AxisState.FAULT)
        self.code = code
        self.raised.append(code)

    def quick_stop(self, code: int) -> None:
        """Stop without a command and stay in QUICK STOP ACTIVE."""
        if self.driven:
            self._leave(AxisState.QUICK_STOP)
            self.code = code
            self.raised.append(code)

    def _clear(self) -> None:
        if self.code:
            self.raised.append(0)
        self.code = 0

    def _go_up(self, word: int) -> None:
        steps = [AxisState.READY, AxisState.SWITCHED_ON, AxisState.ENABLED]
        wanted = 0 if not word & 0x01 else 1 if not word & 0x08 else 2
        at = steps.index(self.state) if self.state in steps else -1
        if wanted > at:
            self._enter(steps[at + 1])
        elif wanted < at:
            self._leave(steps[wanted])

    def _enter(self, state: AxisState) -> None:
        if state is AxisState.ENABLED:
            self.command, self._speed = self.actual, 0.0
            self._segment = self._goal = None
        if state is AxisState.READY:
            self._clear()
        self.state = state

    def _leave(self, state: AxisState) -> None:
        self._segment = self._goal = None
        if state is AxisState.DISABLED and self.state is AxisState.QUICK_STOP:
            self._clear()
        self.state = state

    def _within(self, target: float) -> float:
        inside = min(max(target, self.lower), self.upper)
        self._limited = abs(inside - target) > _LIMIT_MARGIN
        return inside

    def _brake(self, seconds: float) -> None:
        loss = self.ratings.quick * seconds
        self._speed = math.copysign(max(0.0, abs(self._speed) - loss), self._speed)
        if self._speed:
            self.command += self._speed * seconds
        else:
            self._speed = 0.0

    def _profile(self, seconds: float) -> None:
        if self._goal is None:
            self._brake(seconds)
            return
        way = self._goal - self.command
        top = min(self.ratings.speed, math.sqrt(2.0 * self.ratings.acceleration * abs(way)))
        wanted = math.copysign(top, way)
        most = self.ratings.acceleration * seconds
        self._speed += min(max(wanted - self._speed, -most), most)
        if abs(way) <= max(abs(self._speed) * seconds, 1.0):
            self.command, self._speed, self._goal = self._goal, 0.0, None
        else:
            self.command += self._speed * seconds
