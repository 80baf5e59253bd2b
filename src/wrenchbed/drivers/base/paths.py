"""Straight joint-space moves and their speed."""

import numpy as np

from wrenchbed.errors import PlanError
from wrenchbed.robots.base import Robot

SPEED_SHARE = 0.5
"""Share of a joint's top speed that moves between poses use."""
PATH_POINTS = 33
"""Points at which a straight move is checked."""
_PEAK = 1.875
"""Peak over mean speed of a minimum-jerk move: Flash & Hogan 1985."""


def straight(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Points on a straight joint-space line (`PATH_POINTS`, J)."""
    share = np.linspace(0.0, 1.0, PATH_POINTS)[:, None]
    return np.asarray(start + share * (np.asarray(end) - start))


def duration(robot: Robot, start: np.ndarray, end: np.ndarray, share: float = SPEED_SHARE) -> float:
    """Time of a minimum-jerk move whose fastest joint uses its share of top speed [s]."""
    speed = np.array([j.speed for j in robot.joints]) * share
    return max(0.2, float(np.max(_PEAK * np.abs(np.asarray(end) - start) / speed)))


def minimum_jerk(share: np.ndarray) -> np.ndarray:
    """Position 0 … 1 along a move at a share of its time (Flash & Hogan 1985)."""
    return share**3 * (10.0 + share * (-15.0 + 6.0 * share))


def peak_speed(targets: np.ndarray, rate: float) -> np.ndarray:
    """Largest speed (J,) of each joint along a trajectory (N, J) at a rate [Hz]."""
    if len(targets) < 2:
        return np.zeros(targets.shape[1])
    return np.asarray(np.abs(np.diff(targets, axis=0)).max(axis=0) * rate)


def check_motion(robot: Robot, targets: np.ndarray, rate: float, where: str) -> None:
    """Refuse a trajectory (N, J) that leaves limits, the solvable region or the joints' speed.

    Raises:
        PlanError: names the row.
    """
    robot.check(targets, robot.parameters.nominal, where)
    speed = np.abs(np.diff(targets, axis=0)) * rate
    top = np.array([j.speed for j in robot.joints])
    if (speed > top).any():
        row, joint = (int(k[0]) for k in np.nonzero(speed > top))
        unit = robot.joints[joint].unit
        raise PlanError(
            f"{where}: row {row + 1}: {robot.joints[joint].name} would move at "
            f"{speed[row, joint]:.3g} {unit}/s, its limit is {top[joint]:.3g} {unit}/s"
        )
