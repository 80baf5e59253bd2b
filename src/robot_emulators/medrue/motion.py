"""Set-points of a drive's modes: trapezoids in position and speed, and the search for home."""

import math
from dataclasses import dataclass

_NEAR = 1.0
"""Where a position counts as reached by the set-point [count]."""


@dataclass
class MotionSettings:
    """What the master may set; positions [count], speeds [count/s], accelerations [count/s²].

    Attributes:
        lower: software position limit (0x607D:1).
        upper: likewise (0x607D:2).
        window: largest following error (0x6065).
        window_s: how long it may be larger [s] (0x6066).
        near: position window (0x6067).
        near_s: how long the axis must be within [s] (0x6068).
        mode: of operation (0x6060).
        speed: profile velocity, limited by the largest one (0x6081, 0x607F).
        top: the largest one (0x607F).
        up: profile acceleration (0x6083).
        down: profile deceleration (0x6084).
        quick: quick-stop deceleration (0x6085).
        steady: velocity window (0x606D).
        steady_s: how long the speed must be within [s] (0x606E).
        still: speed that counts as zero (0x606F).
        still_s: for how long [s] (0x6070).
        quick_option: 0x605A.
        shutdown_option: 0x605B.
        disable_option: 0x605C.
        halt_option: 0x605D.
        fault_option: 0x605E.
        method: of homing (0x6098).
        search: speed of the search for a switch (0x6099:1).
        creep: speed of the search for its edge (0x6099:2).
        homing_up: acceleration of homing (0x609A).
        home: position of the home (0x607C).
    """

    lower: float
    upper: float
    window: float
    speed: float
    top: float
    up: float
    down: float
    quick: float
    mode: int
    window_s: float = 0.0
    near: float = 0.0
    near_s: float = 0.0
    steady: float = 0.0
    steady_s: float = 0.0
    still: float = 0.0
    still_s: float = 0.0
    quick_option: int = 6
    shutdown_option: int = 0
    disable_option: int = 1
    halt_option: int = 1
    fault_option: int = 2
    method: int = 0
    search: float = 0.0
    creep: float = 0.0
    homing_up: float = 0.0
    home: float = 0.0


@dataclass
class SetPoint:
    """Where an axis shall be [count] and how fast [count/s]."""

    position: float
    speed: float = 0.0

    def to_speed(self, wanted: float, up: float, down: float, seconds: float) -> None:
        """Move for some time towards a speed."""
        faster = wanted * self.speed >= 0.0 and abs(wanted) > abs(self.speed)
        most = (up if faster else down) * seconds
        self.speed += min(max(wanted - self.speed, -most), most)
        self.position += self.speed * seconds

    def to_position(
        self, goal: float, top: float, up: float, down: float, seconds: float
    ) -> bool:  # fmt: skip
        """Move for some time towards a position; whether it is reached."""
        way = goal - self.position
        slow = abs(self.speed) <= 3.0 * down * seconds
        if slow and abs(way) <= max(abs(self.speed) * seconds, _NEAR):
            self.position, self.speed = goal, 0.0
            return True
        wanted = math.copysign(min(top, math.sqrt(2.0 * down * abs(way))), way)
        self.to_speed(wanted, up, down, seconds)
        return False


class Timer:
    """Whether something has held for some time."""

    def __init__(self) -> None:
        self._held = 0.0

    def held(self, holds: bool, needed: float, seconds: float) -> bool:
        """One more step [s]; whether it has held as long as is needed [s]."""
        self._held = self._held + seconds if holds else 0.0
        return holds and self._held >= needed


class SetPoints:
    """Set-points of profile position mode: the one that is followed, and the one after it."""

    def __init__(self) -> None:
        self.goal: float | None = None
        self.next: float | None = None

    def clear(self) -> None:
        """Forget both."""
        self.goal = self.next = None

    def take(self, target: float, at_once: bool) -> bool:
        """A new one; False where there is no room for it."""
        if self.goal is None or at_once:
            self.goal, self.next = target, None
        elif self.next is None:
            self.next = target
        else:
            return False
        return True

    def arrived(self) -> None:
        """The one that is followed is reached."""
        self.goal, self.next = self.next, None

    @property
    def last(self) -> float | None:
        """Where the axis will be in the end."""
        return self.goal if self.next is None else self.next


HERE = (35, 37)
NEGATIVE, POSITIVE = 17, 18
METHODS = (NEGATIVE, POSITIVE, *HERE)
"""Methods of homing (0x6098): the edge of a limit switch without index pulse; where the axis is.
Source: CiA 402."""


class Homing:
    """The search for home.

    Attributes:
        active: whether it searches.
        attained: whether the last search ended at home.
        failed: whether it ended by an error.
    """

    def __init__(self) -> None:
        self.active = self.attained = self.failed = self._backs_off = False

    def start(self) -> None:
        """Begin."""
        self.active, self.attained, self.failed, self._backs_off = True, False, False, False

    def stop(self) -> None:
        """Interrupt."""
        self.active = False

    def step(
        self, point: SetPoint, settings: MotionSettings, switches: tuple[bool, bool], seconds: float
    ) -> bool:
        """Move for some time; whether the axis is at home now.

        Args:
            point: is moved.
            settings: of the axis.
            switches: whether the negative and the positive limit switch are pressed.
            seconds: of this step.
        """
        method, rate = settings.method, settings.homing_up
        if method in HERE:
            return self._end()
        if method not in METHODS:
            self.active, self.failed = False, True
            return False
        sign, pressed = (-1.0, switches[0]) if method == NEGATIVE else (1.0, switches[1])
        if self._backs_off and not pressed:
            point.speed = 0.0
            return self._end()
        self._backs_off = self._backs_off or pressed
        wanted = -sign * settings.creep if self._backs_off else sign * settings.search
        point.to_speed(wanted, rate, rate, seconds)
        return False

    def _end(self) -> bool:
        self.active, self.attained = False, True
        return True
