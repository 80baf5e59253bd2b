"""The article's Denavit–Hartenberg table, read literally, against the manufacturer's."""

import numpy as np

from wrenchbed.frames import rot_x, rot_z
from wrenchbed.robots.ur5.robot import UR5
from wrenchbed.study.ur5.published import ALPHA


def flange(robot: UR5, q: np.ndarray) -> np.ndarray:
    """Flange positions (N, 3) [m] by the article's table with the maker's lengths where it names
    them: a₃, a₄ one row late and positive lengths negated, every dᵢ in its own row."""
    p = robot.values(robot.parameters.nominal)
    a = np.array([0.0, 0.0, p["a2"], p["a3"], 0.0, 0.0])
    d = np.array([p[f"d{i}"] for i in range(1, 7)])
    rotation, position = np.eye(3), np.zeros(3)
    for i in range(6):
        turn = rot_z(q[:, i])
        position = position + (rotation @ turn @ np.array([a[i], 0.0, d[i]]))
        rotation = rotation @ turn @ rot_x(ALPHA[i])
    return position


def distance(robot: UR5, seed: int, n: int = 1000) -> np.ndarray:
    """How far (n,) [m] the article's flange is from the maker's at random poses."""
    q = robot.sample(n, np.random.default_rng(seed))
    true = robot.flange_pose(q, robot.parameters.nominal)[1]
    return np.asarray(np.linalg.norm(flange(robot, q) - true, axis=1))
