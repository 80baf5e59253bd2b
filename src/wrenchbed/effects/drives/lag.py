"""Delay or time constant at which a torque that is late, or filtered, fits best."""

from abc import abstractmethod
from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize_scalar

from wrenchbed.effects.drives.base import Block, Column, DriveEffect, DriveResidual, DriveRows

TIMES = np.geomspace(4e-3, 0.15, 16)
"""Delays and time constants from which the search starts [s]: steps of 1.27, which the search
bridges."""
_CLOSE = 2e-4
"""Error of a found delay or time constant [s]: friction turns at one instant, which a fortieth of a
row resolves."""


def closest(
    change: Callable[[float], np.ndarray], thin: Callable[[np.ndarray], np.ndarray], y: np.ndarray,
    basis: np.ndarray,
) -> float:  # fmt: skip
    """The time [s] whose change of the torque fits best, at its own size, beside other columns.

    Args:
        change: of the torque (N,) by a time [s].
        thin: takes the rows (M,) that count.
        y: measured less predicted torque (M,).
        basis: orthonormal (M, K), of what is ordinary.
    """

    def left(time: float) -> float:
        off = y - thin(change(time))
        return float(off @ off - np.square(basis.T @ off).sum())

    best = int(np.argmin([left(float(t)) for t in TIMES]))
    low, high = TIMES[max(best - 1, 0)], TIMES[min(best + 1, len(TIMES) - 1)]
    minimum = minimize_scalar(left, bounds=(low, high), method="bounded", options={"xatol": _CLOSE})
    return float(minimum.x)


class Lag(DriveEffect):
    """An effect whose block's value is the time by which the effort lags [s]."""

    one_way = True

    @abstractmethod
    def change(self, rows: DriveRows, time: float) -> np.ndarray:
        """What a lag of a time [s] adds (N,)."""

    def scan(
        self, rows: DriveRows, residual: DriveResidual
    ) -> tuple[tuple[Column, ...], Block] | None:
        use = residual.use
        time = closest(
            lambda x: self.change(rows, x), lambda x: residual.thin(x)[use], residual.y[use],
            residual.basis,
        )  # fmt: skip
        column = rows.column(self.name, self.change(rows, time))
        return (column,), self.cause(rows, (column.name,), time, -float(np.log(len(TIMES))))
