"""Drive effect ``drive.viscous``: viscous friction of a joint differs from its stated value."""

import numpy as np

from wrenchbed.effects.drives.base import DriveRows, Size, StatedNumber


class DriveViscous(StatedNumber):
    """τ → τ + δ q̇, τ the effort of the joint, δ the error of its stated viscous friction.

    Seen in: motion at several speeds.
    """

    name = "drive.viscous"
    title = "viscous friction of joint {joint} differs from its stated value"
    size = Size("viscous", "N·m·s/rad", 3.0)
    remedy = "record the same motion again after an hour of running: friction warms"
    word, relative = "viscous", 0.05
    """Ordinary changes of friction from day to day, warming apart: 5 %."""

    def shape(self, rows: DriveRows) -> np.ndarray:
        return rows.speed


EFFECT = DriveViscous()
