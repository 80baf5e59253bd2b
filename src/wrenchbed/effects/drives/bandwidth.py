"""The effort of a joint is low-pass filtered."""

import numpy as np

from wrenchbed.effects.drives.base import Block, Column, DriveResidual, DriveRows, Size
from wrenchbed.effects.drives.lag import Lag
from wrenchbed.effects.drives.operators import slow


class DriveBandwidth(Lag):
    """τ/(1 + T s).

    Seen in: motion with fast reversals.
    """

    name = "drive.bandwidth"
    title = "the effort of joint {joint} is low-pass filtered"
    size = Size("time", "s", 0.1, absolute=True, columns=("drive.",))
    # with more the arm hardly runs: estimate
    remedy = "record a motion with faster reversals, which tells a delay from a filter"

    def scan(
        self, rows: DriveRows, residual: DriveResidual
    ) -> tuple[tuple[Column, ...], Block] | None:
        """None of commands: below their cutoff a filter is as good as a delay, which is named."""
        return super().scan(rows, residual) if rows.command is None else None

    def change(self, rows: DriveRows, torque: np.ndarray, time: float) -> np.ndarray:
        return slow(torque, rows.rate, time)


EFFECT = DriveBandwidth()
