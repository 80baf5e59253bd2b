"""Drive effect ``drive.constant``: wrong gain of a torque sensor, or drive constant: τ (1 + ε)."""

import numpy as np

from wrenchbed.effects.drives.base import DriveRows, Size, StatedNumber


class DriveConstant(StatedNumber):
    """τ → τ (1 + ε), τ the effort of the joint, ε the relative error of its gain.

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
