"""Drive effect ``drive.coulomb``: coulomb friction of a joint differs from its stated value."""

import numpy as np

from wrenchbed.effects.drives.base import DriveRows, Size, StatedNumber


class DriveCoulomb(StatedNumber):
    """τ → τ + δ sign q̇, τ the effort of the joint, δ the error of its stated Coulomb friction.

    Seen in: motion in both directions.
    """

    name = "drive.coulomb"
    title = "Coulomb friction of joint {joint} differs from its stated value"
    size = Size("coulomb", "N·m", 3.0)
    remedy = "record the same motion again after an hour of running: friction warms"
    word, relative = "coulomb", 0.05
    """Ordinary changes of friction from day to day, warming apart: 5 %."""

    def shape(self, rows: DriveRows) -> np.ndarray:
        return rows.sign


EFFECT = DriveCoulomb()
