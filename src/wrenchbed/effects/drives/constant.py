"""The drive constant of a joint, or the gain of its torque sensor, differs."""

import numpy as np

from wrenchbed.effects.drives.base import DriveRows, Size, StatedNumber


class DriveConstant(StatedNumber):
    """τ (1 + ε).

    Seen in: motion that loads the joint.
    """

    name = "drive.constant"
    title = "the drive constant of joint {joint} differs from its stated value"
    size = Size("gain", "1", 0.3, absolute=True)  # with more the arm hardly runs: estimate
    remedy = "record the same motion with a known payload, which tells the drive constant"
    word, relative = "constant", 0.01
    """Ordinary errors of a drive constant or a torque sensor's gain: 1 %, as data sheets of torque
    sensors state."""

    def shape(self, rows: DriveRows) -> np.ndarray:
        return rows.total

    def judged(self, rows: DriveRows) -> bool:
        return self.name not in rows.free


EFFECT = DriveConstant()
