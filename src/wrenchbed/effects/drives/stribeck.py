"""Drive effect ``drive.stribeck``: friction of a joint rises at low speed."""

import numpy as np

from wrenchbed.effects.drives.base import Block, Column, DriveEffect, DriveRows, Size
from wrenchbed.effects.drives.operators import REST

SPEEDS = (0.02, 0.06, 0.15)
"""Speeds over which friction falls [rad/s, m/s]: UR joints fall within 0.02 to 0.1."""

ORDINARY = 0.05
"""Ordinary rise over each of these speeds, one standard deviation, over Coulomb friction: without
it a healthy arm whose friction falls by a tenth has a cause."""


class DriveStribeck(DriveEffect):
    """τ → τ + Σ a sign q̇ exp((u − |q̇|)/v): Stribeck's curve over several speeds v.

    The size is the rise at u, the slowest speed of the rows used: the data show no slower one.

    Seen in: slow motion at several speeds.
    """

    name = "drive.stribeck"
    title = "friction of joint {joint} rises at low speed (Stribeck)"
    size = Size("rise", "N·m", 2.0)
    remedy = "record slow motion at several steady speeds in both directions"
    one_way = True

    def shapes(self, rows: DriveRows) -> dict[str, np.ndarray]:
        size = np.abs(rows.speed)
        above = np.maximum(size - REST * size.max(), 0.0)
        return {f"stribeck{k}": rows.sign * np.exp(-above / v) for k, v in enumerate(SPEEDS)}

    def columns(self, rows: DriveRows) -> tuple[Column, ...]:
        std = ORDINARY * rows.level
        return tuple(rows.column(word, shape, std) for word, shape in self.shapes(rows).items())

    def block(self, rows: DriveRows, columns: tuple[Column, ...]) -> Block | None:
        return self.cause(rows, tuple(c.name for c in columns))


EFFECT = DriveStribeck()
