"""The commanded path: moves and rests of the drives, instant by instant.

Times and shares of limits are estimates.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from wrenchbed.robots.base import SimulatedRobot

MOVE_S, SETTLE_S, MOTION_S = 0.02, 0.02, 0.004
"""Time between instants on a move, while settling, and in a motion [s]."""
_REST_S = 0.35
"""Between arriving and the first row [s]."""
_SPEED = 0.9
"""Share of a joint's top speed on a move."""
_LEAST_S = 0.8
"""Shortest move [s]."""
_CHECKS = 25
"""Points of a move at which the workspace is checked."""


@dataclass(frozen=True, eq=False)
class DrivePath:
    """T instants.

    Attributes:
        t: of each instant (T,) [s].
        q, qd, qdd: as the robot reports them, without noise (T, J).
        rows: instants whose reading is recorded (N,).
        hold: which pose each row belongs to (N,), all 0 in motion.
        placed: instants at which the robot is placed at a pose, without a move.
    """

    t: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    rows: np.ndarray
    hold: np.ndarray
    placed: frozenset[int] = frozenset()

    @property
    def moving(self) -> bool:
        """Whether rows are of a motion."""
        return bool(np.abs(self.qd[self.rows]).max() > 1e-9)


def through(
    robot: SimulatedRobot, poses: np.ndarray, samples: int, rate: float, pause: np.ndarray
) -> DrivePath:
    """Rest at each of the poses (H, J) for ``samples`` rows, with a pause (H,) [s] before each."""
    parts: list[tuple[np.ndarray, ...]] = []
    rows, hold, placed, now, count = [], [], [0], 0.0, 0
    for k, pose in enumerate(poses):
        if k:
            legs = _legs(robot, poses[k - 1], pose)
            if not legs:
                placed.append(count)
                now += 2.0
            for start, end in legs:
                part = _move(robot, start, end, now)
                parts.append(part)
                count, now = count + len(part[0]), float(part[0][-1] + MOVE_S)
        rest = max(1, round((_REST_S + pause[k]) / SETTLE_S))
        t = now + np.concatenate(
            [np.arange(rest) * SETTLE_S, rest * SETTLE_S + np.arange(samples) / rate]
        )
        still = np.zeros((len(t), len(pose)))
        parts.append((t, still + pose, still, still))
        rows += list(range(count + rest, count + len(t)))
        hold += [k] * samples
        count, now = count + len(t), float(t[-1] + 1.0 / rate)
    t, q, qd, qdd = (np.concatenate(x) for x in zip(*parts, strict=True))
    return DrivePath(t, q, qd, qdd, np.array(rows), np.array(hold), frozenset(placed))


def along(motion: CubicSpline, seconds: float, rate: float) -> DrivePath:
    """Follow q(t) from 0 to ``seconds``, after a second of rest."""
    every = max(1, round(1.0 / (rate * MOTION_S)))
    dt = 1.0 / (rate * every)
    lead = round(1.0 / dt)
    n = round(seconds * rate) * every
    t = np.arange(-lead, n) * dt
    at = np.maximum(t, 0.0)
    q, qd, qdd = (
        motion(at, order) * (1.0 if order == 0 else (t >= 0)[:, None]) for order in range(3)
    )
    rows = np.arange(lead, lead + n, every)
    return DrivePath(t, q, qd, qdd, rows, np.zeros(len(rows), dtype=int), frozenset([0]))


def _legs(
    robot: SimulatedRobot, start: np.ndarray, end: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Straight, or by the home pose, if that stays within the workspace; else none."""
    home = robot.home
    for legs in ([(start, end)], [(start, home), (home, end)]):
        share = np.linspace(0.0, 1.0, _CHECKS)[:, None]
        points = np.concatenate([a + share * (b - a) for a, b in legs])
        if not robot.infeasible(points, robot.parameters.nominal):
            return legs
    return []


def _move(
    robot: SimulatedRobot, start: np.ndarray, end: np.ndarray, now: float
) -> tuple[np.ndarray, ...]:
    """A minimum-jerk move (Flash & Hogan 1985, doi 10.1523/JNEUROSCI.05-07-01688.1985)."""
    change = end - start
    top = np.array([j.speed for j in robot.joints]) * _SPEED
    lasts = max(_LEAST_S, float(np.max(1.875 * np.abs(change) / top)))
    n = max(2, round(lasts / MOVE_S))
    s = (np.arange(n) / n)[:, None]
    lasts = n * MOVE_S
    q = start + change * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    qd = change * 30.0 * s**2 * (1.0 - s) ** 2 / lasts
    qdd = change * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / lasts**2
    return now + np.arange(n) * MOVE_S, q, qd, qdd
