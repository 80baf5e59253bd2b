"""Straight joint-space moves, their speed, and the limits checked before anything moves.

Drivers and the recorder check by it before each move: a looser limit reaches real robots. So no
limit or constant is free; tests/hardware judge them.
"""

from dataclasses import dataclass

import numpy as np

from wrenchbed.errors import LimitError, ParameterError, PlanError
from wrenchbed.robots.base import Robot

SPEED_SHARE = 0.5
"""Share of a joint's top speed that moves between poses use."""
PATH_POINTS = 33
"""Number of points at which a straight move is checked."""
_PEAK = 1.875
"""Peak over mean speed of a minimum-jerk move: Flash & Hogan 1985."""


def straight(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Points (`PATH_POINTS`, J) on the straight line in joint space from start to end (J,)."""
    fraction = np.linspace(0.0, 1.0, PATH_POINTS)[:, None]
    return np.asarray(start + fraction * (np.asarray(end) - start))


def entered(robot: Robot, path: np.ndarray) -> np.ndarray:
    """Part of a path (N, J) from its first point within all joint limits on, as a robot that stands
    past a limit may come back; the whole path if no point is."""
    inside = ~np.isin(np.arange(len(path)), list(robot.outside_limits(path)))
    return path[int(np.argmax(inside)) :]


def reachable(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Filter poses q (N, J): keep each that is reached straight from the last one kept."""
    kept: list[np.ndarray] = []
    for pose in q:
        if kept and robot.infeasible(straight(kept[-1], pose), robot.parameters.nominal):
            continue
        kept.append(pose)
    return np.array(kept).reshape(-1, q.shape[1])


def duration(robot: Robot, start: np.ndarray, end: np.ndarray, share: float = SPEED_SHARE) -> float:
    """Duration [s] of a minimum-jerk move between poses (J,), whose fastest joint peaks at
    ``share`` (0 … 1) of its top speed."""
    speed = top_speeds(robot) * share
    return max(0.2, float(np.max(_PEAK * np.abs(np.asarray(end) - start) / speed)))


def minimum_jerk(share: np.ndarray) -> np.ndarray:
    """Fraction of the way, 0 … 1, at a ``share`` of a move's time (Flash & Hogan 1985)."""
    return share**3 * (10.0 + share * (-15.0 + 6.0 * share))


def top_speeds(robot: Robot) -> np.ndarray:
    """Top speed of each joint (J,) [rad/s or m/s]."""
    return np.array([j.speed for j in robot.joints])


def _moves(robot: Robot, j: int, speed: float) -> str:
    return f"{robot.joints[j].name} would move at {speed:.3g} {robot.joints[j].unit}/s"


@dataclass(frozen=True)
class Limits:
    """Limits that a robot's motions are checked against.

    Attributes:
        speed: share of each joint's top speed that moves may use, above 0 and at most 1.
        tracking: share of top speed, above 0, that trajectories and streamed targets may use.
        workspace: where the sensor may be, (lower xyz), (upper xyz) in the world [m]; anywhere if
            None.
        force: largest measured force [N]; the robot is stopped above it. None: no limit.
        torque: largest measured torque [N·m]; the robot is stopped above it. None: no limit.
    """

    speed: float = SPEED_SHARE
    tracking: float = 1.0
    workspace: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None
    force: float | None = None
    torque: float | None = None

    def __post_init__(self) -> None:
        for name in ("speed", "tracking"):
            fraction = getattr(self, name)
            if not 0.0 < fraction <= 1.0:
                raise ParameterError(
                    f"{name} {fraction:g} must be above 0 and at most 1 of top speed"
                )
        for name in ("force", "torque"):
            value = getattr(self, name)
            if value is not None and not value > 0.0:
                raise ParameterError(f"largest {name} {value:g} must be above 0")
        if self.workspace is not None and not (np.diff(self.workspace, axis=0) > 0.0).all():
            raise ParameterError(f"workspace {self.workspace}: each upper bound must be larger")

    def check_path(self, robot: Robot, q: np.ndarray, where: str) -> None:
        """Check poses (N, J) against limits, loops, workspace; errors name ``where`` and row."""
        nominal = robot.parameters.nominal
        robot.check(q, nominal, where)
        if self.workspace is None:
            return
        _, position = robot.sensor_pose(q, nominal)
        lower, upper = np.asarray(self.workspace)
        for row in np.flatnonzero(((position < lower) | (position > upper)).any(axis=1))[:1]:
            x, y, z = position[row]
            raise PlanError(
                f"{where}: row {row}: the sensor would be at ({x:.3f}, {y:.3f}, {z:.3f}) m, "
                "outside the workspace"
            )

    def check_motion(self, robot: Robot, targets: np.ndarray, rate: float, where: str) -> None:
        """Check a trajectory (N, J) at a rate [Hz] as `check_path` does, and its top speeds."""
        self.check_path(robot, targets, where)
        speed, top = np.abs(np.diff(targets, axis=0)) * rate, top_speeds(robot)
        if (speed > self.tracking * top * 1.001).any():
            row, j = divmod(int(np.argmax(speed / top)), len(top))
            raise PlanError(
                f"{where}: row {row + 1}: {_moves(robot, j, speed[row, j])}, "
                f"{speed[row, j] / top[j]:.4g} of its top speed, more than --tracking "
                f"{self.tracking:g}: raise it"
            )

    def check_step(self, robot: Robot, last: np.ndarray, q: np.ndarray, seconds: float) -> str:
        """Reason why target q (J,) may not follow ``last`` after ``seconds``; empty if it may."""
        if q.shape != last.shape or not np.isfinite(q).all():
            return f"a target must be {len(last)} finite numbers"
        try:
            self.check_path(robot, q[None], "target")
        except PlanError as error:
            return str(error)
        top = top_speeds(robot) * self.tracking
        speed = np.abs(q - last) / max(seconds, 1e-6)
        if (speed > 1.05 * top).any():
            j = int(np.argmax(speed / top))
            unit = robot.joints[j].unit
            return f"{_moves(robot, j, speed[j])}, its limit is {top[j]:.3g} {unit}/s"
        return ""

    def check_wrench(self, wrench: np.ndarray) -> None:
        """Raise `LimitError` if a measured wrench (6,) [N, N·m] exceeds the limits."""
        force, torque = np.linalg.norm(wrench[:3]), np.linalg.norm(wrench[3:])
        if self.force is not None and force > self.force:
            raise LimitError(f"measured force {force:.1f} N is above the limit {self.force:g} N")
        if self.torque is not None and torque > self.torque:
            raise LimitError(
                f"measured torque {torque:.2f} N·m is above the limit {self.torque:g} N·m"
            )
