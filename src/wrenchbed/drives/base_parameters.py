"""Which inertial parameters of an arm its joint torques determine, alone or grouped with others.

Columns of the torque regressor at random motions, by QR with pivoting: Gautier 1991, "Numerical
calculation of the base inertial parameters of robots", doi 10.1002/rob.4620080405.
"""

from collections.abc import Sequence

import numpy as np
from scipy.linalg import qr

from wrenchbed.physics.rigid_load_regressor import INERTIAL
from wrenchbed.physics.taylor_jets import Jet
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.robots.inverse_dynamics import torque_regressor

_ROWS, _SEED = 6, 1
"""Rows of the regressor per column, at least, so that its rank is that of the arm, and the seed of
their joint values."""
_DEPENDENT = 1e-8
"""Diagonal of R over its largest below which a column depends on those before."""
NAMES = ("m", "mx", "my", "mz", "xx", "yy", "zz", "xy", "xz", "yz")
"""Names of the ten inertial parameters of a link."""


class BaseParameters:
    """Independent columns of the torque regressor of an arm with parameters theta (P,), and the
    parameters grouped into each; the load's link comes first, so that a payload keeps its name.

    Attributes:
        columns: indices of the kept regressor columns (B,), in order.
        grouping: (B, 10 L): base parameters = grouping @ φ, the 10 inertial parameters of L links.
        names: ``link.<k>.<m, mx …>`` of the kept columns, k from 1.
    """

    def __init__(self, robot: SimulatedRobot, theta: np.ndarray) -> None:
        rng, links = np.random.default_rng(_SEED), len(robot.link_frames(robot.home[None], theta))
        at = robot.sample(-(-_ROWS * INERTIAL * links // len(robot.joints)), rng)
        q = Jet(at, rng.normal(size=at.shape), rng.normal(0.0, 3.0, at.shape))
        y = torque_regressor(robot, theta, q, np.asarray(robot.gravity))
        y = y.reshape(-1, INERTIAL * links)
        scale = np.linalg.norm(y, axis=0)
        seen = scale > _DEPENDENT * scale.max()  # others turn or accelerate nothing
        order = [robot.carrier, *(k for k in reversed(range(links)) if k != robot.carrier)]
        unit = np.divide(1.0, scale, out=np.zeros_like(scale), where=seen)
        self.columns = _independent(y * unit, order)
        self.grouping = np.linalg.lstsq(y[:, self.columns], y, rcond=None)[0]
        self.grouping[np.abs(self.grouping) < _DEPENDENT] = 0.0
        places = [divmod(c, INERTIAL) for c in self.columns.tolist()]
        self.names = tuple(f"link.{link + 1}.{NAMES[k]}" for link, k in places)


def _independent(y: np.ndarray, links: Sequence[int]) -> np.ndarray:
    """Sorted indices of independent columns of y (N, 10 L), preferring those of first ``links``."""
    chosen: list[int] = []
    basis = np.zeros((len(y), 0))
    for link in links:
        of_link = np.arange(INERTIAL * link, INERTIAL * (link + 1))
        remaining = y[:, of_link] - basis @ (basis.T @ y[:, of_link])
        remaining = remaining - basis @ (basis.T @ remaining)  # twice: rounding
        q, r, order = qr(remaining, mode="economic", pivoting=True)
        rank = int((np.abs(np.diagonal(r)) > _DEPENDENT).sum())
        basis = np.concatenate([basis, q[:, :rank]], axis=1)
        chosen += of_link[order[:rank]].tolist()
    return np.array(sorted(chosen))
