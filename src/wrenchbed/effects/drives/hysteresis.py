"""Drive effect ``drive.hysteresis``: the gear of a joint has hysteresis after reversals."""

import numpy as np

from wrenchbed.effects.drives.base import DriveEffect, DriveRows, Size
from wrenchbed.effects.drives.operators import stop

WIDTHS = (1e-2, 3e-2, 1e-1)
"""Half widths of a gear's hysteresis that are tried [rad, m]: steps of 3, which overlap."""


class DriveHysteresis(DriveEffect):
    """τ → τ + Σ a z_w(q), z_w stop operators of several half widths w (Prandtl–Ishlinskii model).

    Seen in: slow motion with reversals after short and long travel.
    """

    name = "drive.hysteresis"
    title = "the gear of joint {joint} has hysteresis after reversals"
    size = Size("size", "N·m", 2.0, columns=("stop",))
    remedy = "record slow motion with reversals after short and long ways"
    beside = ("coulomb",)
    one_way = True

    def shapes(self, rows: DriveRows) -> dict[str, np.ndarray]:
        return {f"stop{k}": stop(rows.angle, w) - rows.sign for k, w in enumerate(WIDTHS)}


EFFECT = DriveHysteresis()
