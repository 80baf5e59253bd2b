"""Poses of the UR5 with its tool pointing right, up, backward, down and left."""

import numpy as np

from wrenchbed.errors import PlanError
from wrenchbed.frames import rot_z
from wrenchbed.robots.ur5.robot import UR5

_AXES = {
    "right": (0.0, -1.0, 0.0), "up": (0.0, 0.0, 1.0), "backward": (-1.0, 0.0, 0.0),
    "down": (0.0, 0.0, -1.0), "left": (0.0, 1.0, 0.0), "forward": (1.0, 0.0, 0.0),
}  # fmt: skip
"""Where the tool's z points in the robot's base, whose x looks forward."""
_LOW, _HIGH = np.array([-0.6, -0.6, 0.25]), np.array([0.6, 0.6, 0.8])
_TRIES = 5000


def poses(
    robot: UR5, direction: str, n: int, rng: np.random.Generator, *, roll: float | None
) -> np.ndarray:
    """Joint values (n, 6) at random positions of the tool.

    Args:
        roll: how the tool is turned about its own axis [rad]; at random for each if None.

    Raises:
        PlanError: too few positions are reachable.
    """
    z = np.array(_AXES[direction])
    x = np.array([0.0, 0.0, 1.0]) if abs(z[2]) < 0.5 else np.array([1.0, 0.0, 0.0])
    facing = np.stack([x, np.cross(z, x), z], axis=-1)
    found: list[np.ndarray] = []
    for _ in range(_TRIES):
        turn = rot_z(rng.uniform(-np.pi, np.pi) if roll is None else roll)
        ways = robot.inverse(facing @ turn, rng.uniform(_LOW, _HIGH))
        if len(ways):
            ways = ways[robot.clear(ways)]
        if len(ways):
            found.append(ways[rng.integers(len(ways))])
        if len(found) == n:
            return np.array(found)
    raise PlanError(f"only {len(found)} of {n} positions with the tool {direction} are reachable")
