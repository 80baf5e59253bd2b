"""Motion of a robot, row by row: the input of every effect, before any effect acts."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from wrenchbed.errors import NotFoundError
from wrenchbed.physics.rotations import cross
from wrenchbed.physics.taylor_jets import Jet, Value, value
from wrenchbed.physics.wrench import Tool, wrench
from wrenchbed.robots.base import Robot

WAY = 7
"""Rows between two poses at rest, so that effects with memory see a joint turn on the way."""
LEAST_MOVE_S = 1.0
"""Shortest move from pose to pose [s]: a short one of a collaborative arm."""
PEAK_SPEED = 1.875
"""Peak over mean speed of a minimum-jerk move: Flash & Hogan 1985,
10.1523/JNEUROSCI.05-07-01688.1985."""
_EXAMPLE_ROWS, _EXAMPLE_RISE = 24, 5.0
"""Poses of `examples`, more than any effect has numbers, and by how much they warm up [K]: as in a
first half hour."""
ACCELERATION, SPIN, TURNING = "acceleration", "spin", "turning"
"""Names of the tool's motion in a scene's ``extra``, sensor axes (M, 3): a [m/s²], ω [rad/s], ω̇
[rad/s²]."""


@dataclass(frozen=True, eq=False)
class Scene:
    """M rows in the order of time: poses at rest with rows on the moves between, or a motion.

    Attributes:
        theta: parameters of the robot as configured (P,).
        gravity: in world axes (3,) [m/s²].
        q: joint values (M, J), in motion a `Jet` (with two time derivatives), or the sensor's
            orientations (M, 4).
        t: time of each row (M,) [s].
        held: whether each row was measured (M,); the others lie on the way between two poses, and
            matter only to effects with memory (hysteresis, creep, backlash).
        warmth: temperature above the first row's (M,) [K], None if not recorded.
        extra: measured accelerations by name (M, 3).
        averaged: whether the rows are averages of one motion without joints, on an even clock.
        located: whether readings depend on where the arm is, not only on its orientation.
    """

    robot: Robot
    theta: np.ndarray
    gravity: np.ndarray
    q: Value
    t: np.ndarray
    held: np.ndarray
    warmth: np.ndarray | None = None
    extra: Mapping[str, np.ndarray] = field(default_factory=dict)
    averaged: bool = False
    located: bool = False

    def __len__(self) -> int:
        return len(self.t)

    @property
    def moving(self) -> bool:
        """Whether the rows are samples of one motion on an even clock."""
        return isinstance(self.q, Jet)

    @property
    def sampled(self) -> bool:
        """Whether the rows are samples, or averages, of one motion on an even clock."""
        return self.moving or self.averaged

    @property
    def mode(self) -> str:
        """Mode of the recording that the rows come from: ``static`` or ``dynamic``."""
        return "dynamic" if self.moving else "static"

    @property
    def jointed(self) -> bool:
        """Whether ``q`` are joint values of a robot with a model, not orientations."""
        return len(self.robot.joints) > 0

    @property
    def period(self) -> float:
        """Sampling period of a motion [s]."""
        return float(np.mean(np.diff(self.t)))

    @property
    def span(self) -> float:
        """Time from the first row to the last [s]."""
        return float(max(self.t[-1] - self.t[0], 1e-9))

    @property
    def age(self) -> np.ndarray:
        """Time since the first row [s] at each row (M,)."""
        return np.asarray(self.t - self.t[0])

    def in_motion(self, x: Value) -> Value:
        """Values (M, …), as they are at rest; in a motion a `Jet`, by finite differences."""
        if not self.moving or isinstance(x, Jet):
            return x
        d = np.gradient(x, self.period, axis=0)
        return Jet(x, d, np.gradient(d, self.period, axis=0))

    def resampled(self, rows: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Rows (M, …) at other times (T,) [s] by a cubic spline, constant beyond the ends."""
        from scipy.interpolate import CubicSpline  # slow to load: only when it is used

        return np.asarray(CubicSpline(self.t, rows)(np.clip(t, self.t[0], self.t[-1])))

    def tool_force(self, load: np.ndarray) -> np.ndarray:
        """Force (M, 3) [N] on the tool alone, of a load (M, 6) less the sensor's own weight."""
        return np.asarray(load[:, :3] * (self.tool.mass / (self.tool.mass + self.tool.sensor_mass)))

    @cached_property
    def joints(self) -> np.ndarray:
        """Joint values (M, J) [rad or m]."""
        return value(self.q)

    @cached_property
    def coming(self) -> np.ndarray:
        """Direction in which each joint last moved (M, J): −1, 1, or 0 before it first moved."""
        if isinstance(self.q, Jet):
            sign = np.where(np.abs(self.q.d) > 1e-4, np.sign(self.q.d), 0.0)
        else:
            step = np.diff(self.joints, axis=0, prepend=self.joints[:1])
            sign = np.where(np.abs(step) > 1e-5, np.sign(step), 0.0)
        return held_on(sign)

    @cached_property
    def pose(self) -> tuple[Value, Value]:
        """Sensor's rotation R_world_sensor (M, 3, 3) and origin (M, 3) [m], from ``theta``."""
        return self.robot.sensor_pose(self.q, self.theta)

    @cached_property
    def tool(self) -> Tool:
        """Tool (mass, centre of gravity, inertia) as stated by the parameters ``theta``."""
        return self.robot.tool(self.theta)

    @cached_property
    def tip(self) -> np.ndarray:
        """The tool's tip (3,) [m] in sensor axes from its origin; if unknown, twice the CoG."""
        q = self.joints[:1]
        try:
            _, end = self.robot.tool_pose(q, self.theta)
        except NotFoundError:
            return 2.0 * self.tool.cog
        rotation, origin = self.robot.sensor_pose(q, self.theta)
        return np.asarray(rotation[0].T @ (end[0] - origin[0]))

    @cached_property
    def load(self) -> np.ndarray:
        """Wrench on the sensor (M, 6) [N, N·m] by the tool as ``theta`` states it."""
        return wrench(*self.pose, self.tool, self.gravity)

    @cached_property
    def inertial(self) -> np.ndarray:
        """Tool's inertial load (M, 6) [N, N·m] by measured accelerations; 0 where none are."""
        if ACCELERATION not in self.extra:
            return np.zeros((len(self), 6))
        tool, spin = self.tool, self.extra[SPIN]
        force = -float(tool.mass) * self.extra[ACCELERATION]
        couple = self.extra[TURNING] @ tool.inertia + cross(spin, spin @ tool.inertia)
        return np.concatenate([force, cross(tool.cog, force) - couple], axis=1)

    @cached_property
    def jolts(self) -> np.ndarray:
        """Wrench (M, 6) [N, N·m] of fast moves between poses at rest, for effects with memory.

        Minimum-jerk moves at the joints' top speeds (`PEAK_SPEED`): the last jolt before a rest is
        the one from which hysteresis comes. 0 where a pose is held, and in motion.
        """
        at = np.flatnonzero(self.held)
        if self.moving or not self.jointed or len(at) == len(self):
            return np.zeros((len(self), 6))
        leg = np.minimum(np.cumsum(self.held) - 1, len(at) - 2)
        first, count = at[leg], np.diff(at)[leg]
        change = np.diff(self.joints[at], axis=0)[leg]
        top = np.array([joint.speed for joint in self.robot.joints])
        lasts = np.maximum(PEAK_SPEED * np.abs(change / top).max(axis=1), LEAST_MOVE_S)
        s = np.linspace(0.0, 1.0, 1001)
        tau = np.interp((np.arange(len(self)) - first) / count, s**3 * (10 - 15 * s + 6 * s**2), s)
        rate = 30.0 * tau**2 * (1.0 - tau) ** 2 / lasts
        turn = 60.0 * tau * (1.0 - tau) * (1.0 - 2.0 * tau) / lasts**2
        q = Jet(self.joints, rate[:, None] * change, turn[:, None] * change)
        return wrench(*self.robot.sensor_pose(q, self.theta), self.tool, self.gravity) - self.load

    @cached_property
    def joint_torque(self) -> np.ndarray:
        """Torque of weight on each joint (M, J) [N·m; N on a slide], by parameters ``theta``."""
        return self.robot.gravity_torque(self.q, self.theta, self.gravity)

    @cached_property
    def base_moment(self) -> np.ndarray:
        """Moment of weight about the base's origin (M, 3) [N·m], by parameters ``theta``."""
        return self.robot.base_moment(self.q, self.theta, self.gravity)


def examples(robot: Robot) -> list[Scene]:
    """Example scenes to ask which effects a robot can show: poses at rest that warm up, then the
    same as a motion, or as averages of one if the robot has no joints."""
    q: Value = robot.sample(_EXAMPLE_ROWS, np.random.default_rng(0))
    theta, gravity = robot.parameters.nominal, np.array(robot.gravity)
    t, held = 10.0 * np.arange(_EXAMPLE_ROWS), np.ones(_EXAMPLE_ROWS, dtype=bool)
    warmth = np.linspace(0.0, _EXAMPLE_RISE, _EXAMPLE_ROWS)
    still = Scene(robot, theta, gravity, q, t, held, warmth)
    if robot.joints:
        return [still, replace(still, q=Jet(q, 0.0 * q, 0.0 * q))]
    return [still, replace(still, averaged=True)]


def held_on(sign: np.ndarray) -> np.ndarray:
    """Signs (M, J) in which each zero is replaced by the last nonzero value before it."""
    there = sign != 0
    if there.all():
        return sign
    at = np.where(there, np.arange(len(sign), dtype=np.int32)[:, None], 0)
    np.maximum.accumulate(at, axis=0, out=at)
    at *= sign.shape[1]
    at += np.arange(sign.shape[1], dtype=np.int32)
    return sign.ravel()[at]
