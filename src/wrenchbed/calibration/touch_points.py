"""Touches: joint values at which the tool's tip sat at a known point of the world."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from wrenchbed.calibration.least_squares import Solution
from wrenchbed.calibration.observability import RANK_TOLERANCE
from wrenchbed.calibration.position_error import tip_jacobian
from wrenchbed.data.holds import gather
from wrenchbed.data.recording import POINT, TOUCH_STD, Recording
from wrenchbed.errors import CalibrationError
from wrenchbed.robots.base import Robot

DOUBT = 0.001
"""Probability below which one of all touches counts as contradicting the other data."""


@dataclass(frozen=True)
class Agreement:
    """How well T touches of known points agree with the wrenches, the prior and each other.

    Attributes:
        std: assumed distance of a tip from its point, per axis [m].
        worst: index of the touch that agrees least with a fit without it.
        distance: distance of that touch in standard deviations of its prediction.
        p_value: probability of so large a distance among all touches.
    """

    count: int
    std: float
    worst: int
    distance: float
    p_value: float

    @property
    def doubtful(self) -> bool:
        """Whether one touch contradicts the other data."""
        return self.p_value < DOUBT


@dataclass(frozen=True, eq=False)
class Touches:
    """T contacts of the tool's tip with known points; the wrenches of the contacts are not used.

    Attributes:
        q: joint values (T, J).
        points: position of the tip (T, 3) in the world [m].
        std: standard uncertainty of these positions, per axis [m].
    """

    q: np.ndarray
    points: np.ndarray
    std: float = TOUCH_STD

    def __len__(self) -> int:
        return len(self.q)

    @classmethod
    def of(cls, recording: Recording, std: float = TOUCH_STD) -> "Touches":
        """Extract the touches of a recording with the columns px py pz, one for each hold.

        Raises:
            CalibrationError: no such columns, a std that is not above 0, or orientations only.
        """
        if not all(c in recording.columns for c in POINT):
            raise CalibrationError(
                f"{recording.name}: no columns px py pz: this is no recording of touches"
            )
        if not 0 < std < np.inf:
            raise CalibrationError(f"touches with a standard deviation of {std} m: must be above 0")
        if not recording.joints:
            raise CalibrationError(f"{recording.name}: touches need joint columns")
        holds = gather(recording, np.ones(len(recording), dtype=bool))
        rows = np.searchsorted(recording.t, holds.t).clip(0, len(recording) - 1)
        points = np.stack([recording.columns[c][rows] for c in POINT], axis=-1)
        return cls(holds.q, points, std)

    def residual(self, robot: Robot, theta: np.ndarray) -> np.ndarray:
        """Stated minus predicted tip positions (3T,), in standard deviations."""
        robot_theta = robot.robot_theta(theta)
        return ((self.points - robot.tool_pose(self.q, robot_theta)[1]) / self.std).ravel()

    def jacobian(self, robot: Robot, theta: np.ndarray, columns: Sequence[int]) -> np.ndarray:
        """Derivative (3T, K) of predicted tip positions, in standard deviations, by the parameters
        with the indices ``columns``."""
        return tip_jacobian(robot, self.q, theta, columns).reshape(-1, len(columns)) / self.std

    def agreement(self, solution: Solution, first: int) -> Agreement:
        """Compare each touch with its prediction from all other data (deletion residuals);
        ``first`` is the row of the whitened solution at which the touches begin."""
        rows = slice(first, first + 3 * len(self))
        residual = solution.residual[rows].reshape(len(self), 3)
        u, sizes, _ = np.linalg.svd(solution.jacobian, full_matrices=False)
        hat = u[rows, sizes > RANK_TOLERANCE * sizes[0]].reshape(len(self), 3, -1)
        off = np.eye(3) - hat @ np.swapaxes(hat, -1, -2)
        square = np.einsum("ti,tij,tj->t", residual, np.linalg.pinv(off, hermitian=True), residual)
        worst = int(np.argmax(square))
        p_value = min(1.0, len(self) * float(special.chdtrc(3, square[worst])))
        return Agreement(len(self), self.std, worst, float(np.sqrt(square[worst])), p_value)
