"""Torques that repeat with the joint's angle, two harmonics of a period that a residual shows."""

from abc import abstractmethod
from typing import ClassVar

import numpy as np

from wrenchbed.effects.drives.base import Block, Column, DriveEffect, DriveResidual, DriveRows

HARMONICS = (1, 2)
"""Of a period: a gear's teeth or a motor's poles make more than a sine; estimate."""


def first_of(effect: str) -> tuple[str, ...]:
    """Beginnings of the names of an effect's columns at its period itself: their length is its
    amplitude."""
    return f"{effect}.sine1", f"{effect}.cosine1"


class Wave(DriveEffect):
    """An effect whose block's value is periods a turn."""

    tried: ClassVar[float]
    """Periods that are looked through, each of which could be the one."""

    @abstractmethod
    def periods(self, residual: DriveResidual) -> float:
        """Periods a turn that a residual shows most."""

    def columns(self, rows: DriveRows) -> tuple[Column, ...]:
        return ()

    def scan(self, rows: DriveRows, residual: DriveResidual) -> tuple[tuple[Column, ...], Block]:
        turns = self.periods(residual)
        columns = tuple(
            rows.column(f"{self.name}.{word}{k}", wave(k * turns * rows.angle))
            for k in HARMONICS
            for word, wave in (("sine", np.sin), ("cosine", np.cos))
        )
        names = tuple(c.name for c in columns)
        return columns, Block(
            self.name, rows.joint, False, names, turns, -float(np.log(self.tried))
        )
