"""Drive effect ``drive.asymmetry``: friction of a joint differs by direction."""

import numpy as np

from wrenchbed.effects.drives.base import DriveEffect, DriveRows, Size


class DriveAsymmetry(DriveEffect):
    """τ → τ + a |q̇| + b, τ the effort of the joint: viscous and Coulomb part that keep their sign.

    Seen in: motion in both directions at several speeds.
    """

    name = "drive.asymmetry"
    title = "friction of joint {joint} differs by direction"
    size = Size("difference", "N·m·s/rad", 2.0, columns=("asymmetry",))
    beside = ("offset",)

    def shapes(self, rows: DriveRows) -> dict[str, np.ndarray]:
        return {"asymmetry": np.abs(rows.speed)}


EFFECT = DriveAsymmetry()
