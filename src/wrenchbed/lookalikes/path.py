"""The way between poses: straight moves in the joints, for everything that has a memory."""

from dataclasses import dataclass

import numpy as np

from wrenchbed.lookalikes.rigid import Load, Motion, load_wrench, stand
from wrenchbed.robots.base import Robot

STEPS = 4
"""Points on the move to each pose; the last one is the pose itself."""


@dataclass(frozen=True, eq=False)
class Path:
    """A sequence of T instants that passes every pose.

    Attributes:
        t: (T,) [s].
        q: (T, J) joint values.
        wrench: nominal (T, 6) [N, N·m].
        felt: specific force in sensor axes (T, 3) [m/s²].
        torque: that the joints carry (T, J) [N·m or N], empty without joints.
        at: index into the sequence of each hold or sample (N,).
    """

    t: np.ndarray
    q: np.ndarray
    wrench: np.ndarray
    felt: np.ndarray
    torque: np.ndarray
    at: np.ndarray


def path_of_motion(
    t: np.ndarray, q: np.ndarray, motion: Motion, wrench: np.ndarray, torque: np.ndarray
) -> Path:
    """The samples of a motion are their own path."""
    return Path(t, q, wrench, motion.felt, torque, np.arange(len(t)))


def path_of_holds(
    robot: Robot, theta: np.ndarray, t: np.ndarray, q: np.ndarray, gravity: np.ndarray, load: Load
) -> Path:
    """Straight joint-space moves from hold to hold (H, J), without joint torques."""
    share = np.arange(1, STEPS + 1) / STEPS
    before = np.concatenate([q[:1], q[:-1]])
    aim = q
    if not robot.joints:
        aim = q * np.where((before * q).sum(axis=1, keepdims=True) < 0.0, -1.0, 1.0)
    way = before[:, None] + share[None, :, None] * (aim - before)[:, None]
    way = way.reshape(-1, q.shape[1])
    if not robot.joints:
        way = way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
    with np.errstate(invalid="ignore", divide="ignore"):
        motion = stand(robot, theta, way, gravity)
    at = np.arange(STEPS - 1, len(way), STEPS)
    broken = ~np.isfinite(motion.rotation).all(axis=(1, 2))
    if broken.any():  # the straight move leaves the workspace: the robot waits at its start
        last = np.maximum.accumulate(np.where(broken, -1, np.arange(len(way))))
        way = way[np.maximum(last, at[0])]
        motion = stand(robot, theta, way, gravity)
    since = np.concatenate([t[:1] - 1.0, t[:-1]])
    times = (since[:, None] + share * (t - since)[:, None]).ravel()
    wrench = load_wrench(motion, load)
    return Path(times, way, wrench, motion.felt, np.zeros((len(way), 0)), at)
