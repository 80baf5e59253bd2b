"""Drive effect ``drive.delay``: the effort of a joint is reported late."""

import numpy as np

from wrenchbed.effects.drives.base import Column, DriveRows, Size
from wrenchbed.effects.drives.delay_fit import Lag
from wrenchbed.effects.drives.operators import late

LATE = 2e-3
"""Ordinary delay of one joint's effort beside the others', one standard deviation [s]: the lesser
of the 2 to 8 ms in which controllers report."""


class DriveDelay(Lag):
    """τ(t) → τ(t − T), τ the effort of the joint, T the delay.

    Seen in: motion with fast reversals.
    """

    name = "drive.delay"
    title = "the effort of joint {joint} is reported late"
    size = Size("delay", "s", 0.1, absolute=True, columns=("drive.", "late"))  # estimate:
    # with more the arm hardly runs
    beside = ("late",)
    remedy = "record a motion with faster reversals, which tells a delay from a filter"

    def columns(self, rows: DriveRows) -> tuple[Column, ...]:
        spread = rows.spread.get(self.name) or LATE
        return (rows.column("late", late(rows.lagging, rows.t, LATE) / LATE, spread),)

    def change(self, rows: DriveRows, torque: np.ndarray, time: float) -> np.ndarray:
        return late(torque, rows.t, time)


EFFECT = DriveDelay()
