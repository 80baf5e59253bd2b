"""Drive effect ``drive.offset``: the zero of a torque sensor is off, or a constant torque acts."""

import numpy as np

from wrenchbed.effects.drives.base import DriveRows, Size, StatedNumber


class DriveOffset(StatedNumber):
    """τ → τ + δ, τ the effort of the joint, δ the error of its zero or stated constant torque.

    Seen in: motion in both directions, under gravity of both signs.
    """

    name = "drive.offset"
    title = "the zero of joint {joint}'s torque sensor is off"
    size = Size("offset", "N·m", 3.0)
    remedy = "read the joint's effort unloaded, or with the arm hanging straight down"
    word, relative = "offset", 0.05
    """Ordinary changes of a stated constant torque: 5 %, as of friction."""

    def shape(self, rows: DriveRows) -> np.ndarray:
        return np.ones_like(rows.speed)


EFFECT = DriveOffset()
