"""What a master sets of a drive's motion, and set-points in trapezoids of position and speed."""

import math
from dataclasses import dataclass
from typing import Annotated, get_type_hints

from robot_emulators.canopen.dictionary import Objects

METHODS = (35, 37)
"""Methods of homing (0x6098), both: the home is where the axis is; source: CiA 402."""
_NEAR = 1.0
"""Where a position counts as reached by the set-point [count]."""
_MS = 1e-3


@dataclass(frozen=True)
class MotionSettings:
    """What the master may set, each with its object; source: CiA 402.

    Positions are in counts, speeds in count/s, accelerations in count/s²; times of a drive in
    milliseconds are [s] here.
    """

    quick_option: Annotated[int, 0x605A, 0]
    shutdown_option: Annotated[int, 0x605B, 0]
    disable_option: Annotated[int, 0x605C, 0]
    halt_option: Annotated[int, 0x605D, 0]
    fault_option: Annotated[int, 0x605E, 0]
    mode: Annotated[int, 0x6060, 0]
    following_window: Annotated[float, 0x6065, 0]
    following_s: Annotated[float, 0x6066, 0, _MS]
    position_window: Annotated[float, 0x6067, 0]
    position_s: Annotated[float, 0x6068, 0, _MS]
    speed_window: Annotated[float, 0x606D, 0]
    speed_s: Annotated[float, 0x606E, 0, _MS]
    still_speed: Annotated[float, 0x606F, 0]
    still_s: Annotated[float, 0x6070, 0, _MS]
    home: Annotated[float, 0x607C, 0]
    lower: Annotated[float, 0x607D, 1]
    upper: Annotated[float, 0x607D, 2]
    top_speed: Annotated[float, 0x607F, 0]
    profile_speed: Annotated[float, 0x6081, 0]
    acceleration: Annotated[float, 0x6083, 0]
    deceleration: Annotated[float, 0x6084, 0]
    quick_stop: Annotated[float, 0x6085, 0]
    homing_method: Annotated[int, 0x6098, 0]

    @property
    def speed(self) -> float:
        """Of a profile, which the largest speed limits."""
        return min(self.profile_speed, self.top_speed)


_OBJECTS = {
    name: hint.__metadata__
    for name, hint in get_type_hints(MotionSettings, include_extras=True).items()
}


def settings(objects: Objects) -> MotionSettings:
    """The settings that a dictionary holds now."""
    return MotionSettings(
        **{
            name: objects[index, sub] * math.prod(unit)
            for name, (index, sub, *unit) in _OBJECTS.items()
        }
    )


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
