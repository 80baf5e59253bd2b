"""Drive effect ``drive.bandwidth``: the effort of a joint is low-pass filtered."""

import numpy as np

from wrenchbed.effects.drives.base import DriveRows, Size
from wrenchbed.effects.drives.delay_fit import Lag
from wrenchbed.effects.drives.operators import slow


class DriveBandwidth(Lag):
    """τ → τ/(1 + T s), τ the effort of the joint, T a time constant, s Laplace's variable.

    Seen in: motion with fast reversals.
    """

    name = "drive.bandwidth"
    title = "the effort of joint {joint} is low-pass filtered"
    size = Size("time", "s", 0.1, absolute=True, columns=("drive.",))  # estimate:
    # with more the arm hardly runs
    remedy = "record a motion with faster reversals, which tells a delay from a filter"

    def shows(self, rows: DriveRows) -> bool:
        return rows.command is None  # of servo commands a delay is fitted

    def change(self, rows: DriveRows, torque: np.ndarray, time: float) -> np.ndarray:
        return slow(torque, rows.rate, time)


EFFECT = DriveBandwidth()
