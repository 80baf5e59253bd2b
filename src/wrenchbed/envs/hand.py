"""The tip of a robot's tool, moved along straight lines with its orientation kept."""

import math

import numpy as np

from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.serving.surface import tip_of

_STEP, _DAMPING = 1e-6, 1e-6
_FAR = 0.006
"""Way of the tip after which the Jacobian is evaluated anew [m], and what was missed meanwhile,"""
_MADE_UP, _OFTEN = 10, 50
"""which the next moves, so many, make up for; in slow motion after so many moves."""


class Hand:
    """Joint targets that lead the tip of a nominal robot.

    Args:
        robot: stands at home.

    Attributes:
        q: joint targets (J,).
        tip: where they put the tip (3,) [m].
        kept: orientation of the tool (3, 3).
    """

    def __init__(self, robot: SimulatedRobot) -> None:
        self.robot = robot
        self._theta = robot.parameters.nominal
        self.q = np.asarray(robot.home, dtype=float)
        self._limits = np.array([(j.lower, j.upper) for j in robot.joints])
        rotation, places = tip_of(robot, self.q[None], self._theta)
        self.kept, self.tip = rotation[0], places[0]
        self._gone, self._age = np.inf, 0

    def move(self, way: np.ndarray, parts: int) -> np.ndarray:
        """Joint values (parts, J) that move the tip by ``way`` (3,) [m] in the world.

        At a limit of the joints or of the workspace it stands still.
        """
        if self._gone >= _FAR or self._age >= _OFTEN:
            self._look()
        twist = self._back.copy() if self._age < _MADE_UP else np.zeros(6)
        twist[:3] += way
        new = self.q + self._inverse @ twist
        length = math.sqrt(way @ way)
        if self._blocked(new, length):
            return np.repeat(self.q[None], parts, axis=0)
        share = np.arange(1, parts + 1)[:, None] / parts
        line = self.q + share * (new - self.q)
        self.q, self.tip = new, self.tip + way
        self._age, self._gone = self._age + 1, self._gone + length
        return np.asarray(line)

    def _look(self) -> None:
        """The Jacobian here, and what the last moves missed."""
        rotation, tip, jacobian = self._slopes()
        missed = np.concatenate([self.tip - tip, _vector(self.kept @ rotation.T)])
        self._back, self._age, self._gone = missed / _MADE_UP, 0, 0.0
        square = jacobian @ jacobian.T + _DAMPING * np.eye(6)
        self._inverse = jacobian.T @ np.linalg.inv(square)

    def _blocked(self, new: np.ndarray, length: float) -> bool:
        """Whether a target is out of reach; far from the edge one look ahead is enough."""
        low, high = self._limits.T
        if ((new < low) | (new > high)).any():
            return True
        if self._age == 0:
            ahead = self.q + 2 * _FAR / max(length, _STEP) * (new - self.q)
            self._close = bool(self.robot.infeasible(ahead[None], self._theta))
        return self._close and bool(self.robot.infeasible(new[None], self._theta))

    def _slopes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Orientation (3, 3), place (3,) and Jacobian (6, J): speed above, turning below."""
        count = len(self.q)
        around = self.q + np.vstack([np.zeros(count), _STEP * np.eye(count)])
        rotation, tip = tip_of(self.robot, around, self._theta)
        turns = rotation[1:] @ rotation[0].T
        turning = np.stack([_vector(turn) for turn in turns], axis=1)
        return rotation[0], tip[0], np.vstack([(tip[1:] - tip[0]).T, turning]) / _STEP


def _vector(turn: np.ndarray) -> np.ndarray:
    """Rotation vector (3,) of a small rotation (3, 3) [rad]."""
    return 0.5 * np.array(
        [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
    )
