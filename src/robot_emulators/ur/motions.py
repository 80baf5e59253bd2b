"""Motions of the arm: each computes the joints' target of every control cycle."""

import contextlib
from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import atan2, cos, exp, pi, sin, sqrt

import numpy as np

from robot_emulators.ur import kinematics as poses
from robot_emulators.ur.kinematics import Kinematics, UnreachableError, matrix, rotation_vector

ROTATION_REACH = 0.25
"""Length [m] of a straight move that takes as long as a turn of the tool by 1 rad."""
_STILL = 1e-4
_FLAT = 1e-12
"""Square of an area [m⁴] below which three points count as on one line."""
_FULL_SPEED, _HARDEST = 0.9, 15.0
"""Most that a move of given duration may use: of joint speeds (fraction); acceleration [rad/s²]."""
_LOOKS = 24
"""Number of places along a path at which joint speeds are checked before the arm moves."""
_GAIN = 300.0
"""Default gain of servoj, at which the arm lags by the lookahead time."""


class Profile:
    """Trapezoidal speed profile along a path of ``length`` [rad or m] up to a top speed."""

    def __init__(self, length: float, speed: float, acceleration: float) -> None:
        self.length, self._a = length, acceleration
        self._v = min(speed, sqrt(length * acceleration))
        self._ramp = self._v / acceleration
        self.duration = 0.0 if length <= 0.0 else length / self._v + self._ramp

    @classmethod
    def lasting(cls, length: float, seconds: float) -> "Profile":
        """Make a profile over ``length`` [rad or m] in a duration [s]; each ramp takes a fifth."""
        speed = max(length, 1e-12) / (0.8 * seconds)
        return cls(length, speed, speed / (0.2 * seconds))

    def at(self, t: float) -> float:
        """Path length [rad or m] covered at a time [s] after the start."""
        if t >= self.duration:
            return self.length
        if t < self._ramp:
            return 0.5 * self._a * t * t
        remaining = self.duration - t
        if remaining < self._ramp:
            return self.length - 0.5 * self._a * remaining * remaining
        return self._v * (t - 0.5 * self._ramp)


@dataclass(frozen=True)
class Pace:
    """Speed, acceleration or duration of a move.

    Attributes:
        speed, acceleration: along the path, [m/s, m/s²] or [rad/s, rad/s²].
        seconds: duration [s], which replaces both; 0: they decide.
        top: top speeds (6,) of the joints [rad/s]; a duration too short for them is extended.
    """

    speed: float
    acceleration: float
    seconds: float = 0.0
    top: np.ndarray | float = np.inf


class ArmMotion(ABC):
    """A motion that moves the arm, stepped once a control cycle.

    Attributes:
        done: whether the motion has ended.
        scaled: whether the speed slider slows it down.
    """

    done = False
    scaled = False

    @abstractmethod
    def begin(self, q: np.ndarray, qd: np.ndarray) -> None:
        """Start or resume the motion at joint values (6,) [rad] and speeds (6,) [rad/s]."""

    @abstractmethod
    def step(self, q: np.ndarray, dt: float) -> np.ndarray:
        """Return the joint target (6,) a time ``dt`` [s] after the target q (6,). Raises an
        `UnreachableError` if the path cannot be continued.
        """


class Braking(ArmMotion):
    """Motion that brings all joints to rest at the same moment.

    Args:
        deceleration: deceleration of the fastest joint [rad/s²].
        seconds: time to rest [s], which replaces the deceleration.
    """

    def __init__(self, deceleration: float, seconds: float | None = None) -> None:
        self._rate, self._seconds = max(deceleration, 0.01), seconds

    def begin(self, q: np.ndarray, qd: np.ndarray) -> None:
        self._qd, self._t = np.array(qd), 0.0
        asked = np.abs(qd).max() / self._rate if self._seconds is None else self._seconds
        self._duration = float(asked)
        self.done = bool(np.abs(qd).max() < _STILL or self._duration <= 0.0)

    def step(self, q: np.ndarray, dt: float) -> np.ndarray:
        if self.done:
            return q
        before, self._t = self._t, min(self._t + dt, self._duration)
        self.done = self._t >= self._duration
        middle = 1.0 - 0.5 * (before + self._t) / self._duration
        return q + self._qd * middle * (self._t - before)


class _Planned(ArmMotion):
    """A move along a path known in advance, begun once the arm has braked to rest."""

    scaled = True

    def __init__(self, pace: Pace) -> None:
        self._pace = pace

    def begin(self, q: np.ndarray, qd: np.ndarray) -> None:
        self._braking = Braking(max(self._pace.acceleration, 2.0))
        self._braking.begin(q, qd)
        self._profile: Profile | None = None

    def step(self, q: np.ndarray, dt: float) -> np.ndarray:
        if not self._braking.done:
            return self._braking.step(q, dt)
        if self._profile is None:
            self._t, pace, length = 0.0, self._pace, self._plan(q)
            self._profile = (
                Profile.lasting(length, max(pace.seconds, self._least(q))) if pace.seconds > 0.0
                else Profile(length, max(pace.speed, 1e-4), max(pace.acceleration, 1e-3))
            )  # fmt: skip
        self._t += dt
        self.done = self._t >= self._profile.duration
        length = self._profile.length
        return self._at(self._profile.at(self._t) / length if length > 0.0 else 1.0, q)

    def _least(self, q: np.ndarray) -> float:
        """Least duration [s] of this path from q (6,) by the joints' speeds and accelerations."""
        before, steepest = q, np.zeros(6)
        with contextlib.suppress(UnreachableError):
            for k in range(1, _LOOKS + 1):
                following = self._at(k / _LOOKS, before)
                steepest = np.maximum(steepest, _LOOKS * np.abs(following - before))
                before = following
        fastest = float((steepest / self._pace.top).max())
        return max(fastest / (0.8 * _FULL_SPEED), sqrt(float(steepest.max()) / (0.16 * _HARDEST)))

    @abstractmethod
    def _plan(self, q: np.ndarray) -> float:
        """Plan the path from joint values q (6,); return its length [rad or m]."""

    @abstractmethod
    def _at(self, share: float, q: np.ndarray) -> np.ndarray:
        """Joint values (6,) at a fraction 0 … 1 of the path's length; q (6,) is a nearby guess."""


class ToJoints(_Planned):
    """movej to ``goal`` (6,): all joints start and arrive together, at the longest way's pace."""

    def __init__(self, goal: np.ndarray, pace: Pace) -> None:
        super().__init__(pace)
        self.goal = goal

    def _plan(self, q: np.ndarray) -> float:
        self._start = np.array(q)
        return float(np.abs(self.goal - q).max())

    def _at(self, share: float, q: np.ndarray) -> np.ndarray:
        return np.asarray(self._start + share * (self.goal - self._start))


class ToPose(_Planned):
    """movel to a pose ``goal`` (6,): the TCP moves on a straight line and turns about an axis."""

    def __init__(
        self, kinematics: Kinematics, tcp: np.ndarray, goal: np.ndarray, pace: Pace
    ) -> None:
        super().__init__(pace)
        self._kinematics, self._tcp, self.goal = kinematics, tcp, goal

    def _plan(self, q: np.ndarray) -> float:
        self._rotation, self._from = self._kinematics.transform(q, self._tcp)
        rotation, position = matrix(self.goal)
        self._way = position - self._from
        self._turn = rotation_vector(rotation @ self._rotation.T)
        turn = ROTATION_REACH * float(np.linalg.norm(self._turn))
        return max(float(np.linalg.norm(self._way)), turn)

    def _at(self, share: float, q: np.ndarray) -> np.ndarray:
        turn, _ = matrix(np.concatenate([np.zeros(3), share * self._turn]))
        pose = poses.vector(turn @ self._rotation, self._place(share))
        joints = self._kinematics.follow(pose, self._tcp, q)
        if joints is None:
            raise UnreachableError("the straight way leaves the robot's reach")
        return joints

    def _place(self, share: float) -> np.ndarray:
        return np.asarray(self._from + share * self._way)


class ToArc(ToPose):
    """movec: the TCP moves on a circle through the pose poses[0] (6,) to poses[1] (6,) and turns
    about one axis."""

    def __init__(
        self, kinematics: Kinematics, tcp: np.ndarray, poses: tuple[np.ndarray, np.ndarray],
        pace: Pace,
    ) -> None:  # fmt: skip
        super().__init__(kinematics, tcp, poses[1], pace)
        self._via = poses[0][:3]

    def _plan(self, q: np.ndarray) -> float:
        straight = super()._plan(q)
        first, last = self._via - self._from, self._way
        normal = np.cross(first, last)
        size = float(normal @ normal)
        self._radius = 0.0
        if size < _FLAT:
            return straight
        middle = np.cross((first @ first) * last - (last @ last) * first, normal) / (2.0 * size)
        self._centre = self._from + middle
        self._x = -middle
        self._radius = float(np.linalg.norm(middle))
        self._y = np.cross(normal / sqrt(size), self._x)
        far = last - middle
        self._angle = atan2(float(far @ self._y), float(far @ self._x)) % (2.0 * pi)
        return max(straight, self._radius * self._angle)

    def _place(self, share: float) -> np.ndarray:
        if self._radius == 0.0:
            return super()._place(share)
        angle = share * self._angle
        return np.asarray(self._centre + cos(angle) * self._x + sin(angle) * self._y)


class Servo(ArmMotion):
    """servoj: the joints follow a target that is set repeatedly, smoothed by the lookahead time."""

    def __init__(self) -> None:
        self._goal, self._speed = np.zeros(6), np.zeros(6)
        self._rate = 1.0

    def aim(self, goal: np.ndarray, lookahead: float, gain: float) -> None:
        """Set a new joint target (6,) [rad], with servoj's lookahead time [s] and unitless gain."""
        self._goal = goal
        lag = min(max(lookahead, 0.03), 0.2) * _GAIN / min(max(gain, 100.0), 2000.0)
        self._rate = 2.0 / max(lag, 0.03)

    @property
    def lag(self) -> float:
        """Time by which the joints trail a moving target [s]."""
        return 2.0 / self._rate

    def distance(self, q: np.ndarray) -> np.ndarray:
        """Distance of each joint from q (6,) to the target (6,) [rad], never negative."""
        return np.asarray(np.abs(self._goal - q))

    def begin(self, q: np.ndarray, qd: np.ndarray) -> None:
        self._speed = np.array(qd)

    def step(self, q: np.ndarray, dt: float) -> np.ndarray:
        """Joint target (6,) ``dt`` [s] after target q (6,), by a critically damped filter."""
        w, miss = self._rate, q - self._goal
        fade, slope = exp(-w * dt), self._speed + w * miss
        self._speed = (self._speed - w * dt * slope) * fade
        return np.asarray(self._goal + (miss + slope * dt) * fade)


class JointSpeed(ArmMotion):
    """speedj: the joints accelerate to given speeds and keep them until another motion."""

    def __init__(self) -> None:
        self._goal, self._speed = np.zeros(6), np.zeros(6)
        self._rate = 1.0

    @property
    def reached(self) -> bool:
        """Whether the joints have reached the speeds last commanded."""
        return bool(np.abs(self._speed - self._goal).max() < _STILL)

    def aim(self, speed: np.ndarray, acceleration: float) -> None:
        """Set new joint speeds (6,) [rad/s] and the acceleration towards them [rad/s²]."""
        self._goal, self._rate = speed, max(acceleration, 0.01)

    def begin(self, q: np.ndarray, qd: np.ndarray) -> None:
        self._speed = np.array(qd)

    def step(self, q: np.ndarray, dt: float) -> np.ndarray:
        """Joint target (6,) ``dt`` [s] after target q (6,); speeds approach the commanded ones."""
        change, most = self._goal - self._speed, self._rate * dt
        largest = float(np.abs(change).max())
        self._speed = self._speed + change * (most / max(largest, most))
        return np.asarray(q + self._rates(q) * dt)

    def _rates(self, q: np.ndarray) -> np.ndarray:
        """Joint speeds (6,) [rad/s] that the present command demands at joint values q (6,)."""
        return self._speed


class ToolSpeed(JointSpeed):
    """speedl: the TCP accelerates to a velocity in base axes [m/s, rad/s] and keeps it."""

    def __init__(self, kinematics: Kinematics, tcp: np.ndarray) -> None:
        super().__init__()
        self._kinematics, self._tcp = kinematics, tcp

    def begin(self, q: np.ndarray, qd: np.ndarray) -> None:
        self._speed = self._kinematics.jacobian(q, self._tcp) @ qd

    def _rates(self, q: np.ndarray) -> np.ndarray:
        return self._kinematics.rates(q, self._tcp, self._speed)


class ToolTrack(ToolSpeed):
    """servoc: the TCP moves straight to a pose that is set repeatedly, and stays there."""

    def track(self, pose: np.ndarray, speed: float, acceleration: float) -> None:
        """Set a new target pose (6,) in the base, the TCP's speed [m/s] and acceleration [m/s²]."""
        self._pose, self._top, self._rate = pose, max(speed, 1e-4), max(acceleration, 0.01)

    def step(self, q: np.ndarray, dt: float) -> np.ndarray:
        rotation, position = self._kinematics.transform(q, self._tcp)
        goal_rotation, goal = matrix(self._pose)
        turn = rotation_vector(goal_rotation @ rotation.T)
        way = np.concatenate([goal - position, turn])
        length = max(float(np.linalg.norm(way[:3])), ROTATION_REACH * float(np.linalg.norm(turn)))
        if length > 0.0:
            speed = min(self._top, (self._rate * length) ** 0.5, length / (2.0 * dt))
            self._goal = way / length * speed
        return super().step(q, dt)
