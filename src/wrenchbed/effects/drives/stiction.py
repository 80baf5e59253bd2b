"""Drive effect ``drive.stiction``: a joint sticks at reversals."""

import numpy as np

from wrenchbed.effects.drives.base import Column, DriveEffect, DriveRows, Size

WAYS = (3e-4, 1e-3, 3e-3, 1e-2, 4e-2)
"""Ways after a reversal over which friction builds up or breaks away [rad, m]: steps of three,
which overlap in shape."""
ROUNDED = 3e-3
"""Longest way after a reversal that ordinary bristles need [rad, m]: 0.2°."""


class DriveStiction(DriveEffect):
    """τ → τ + Σ a sign q̇ exp(−s/w), s the distance since the last reversal, over several widths w.

    Terms of the shortest widths occur in every healthy drive, unstated (presliding).

    Seen in: slow motion with many reversals.
    """

    name = "drive.stiction"
    title = "joint {joint} sticks at reversals"
    size = Size("size", "N·m", 2.0)
    remedy = "record slow motion with many reversals"
    one_way = True

    def columns(self, rows: DriveRows) -> tuple[Column, ...]:
        return tuple(
            rows.column(
                f"since{k}",
                rows.sign * np.exp(-rows.since / way),
                rows.level if way <= ROUNDED else None,
            )
            for k, way in enumerate(WAYS)
        )


EFFECT = DriveStiction()
