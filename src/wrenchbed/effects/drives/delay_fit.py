"""Fits of a delay or of a filter's time constant to a joint's effort."""

from abc import abstractmethod
from collections.abc import Callable

import numpy as np
import scipy  # which loads its slow submodules when they are first used

from wrenchbed.effects.drives.base import Block, Column, DriveEffect, DriveResidual, DriveRows
from wrenchbed.effects.drives.operators import direction

TIMES = np.geomspace(4e-3, 0.15, 16)
"""Delays and time constants from which the search starts [s]: it bridges steps of 1.27."""
_CLOSE = 2e-4
"""Error of a found delay or time constant [s]: friction turns at one instant, which a fortieth of a
row resolves."""
TURNS = 0.003
"""Share of a joint's largest speed from which late friction has turned: where a joint rests no row
counts, but a late turn comes when it moves. Encoders' noise of 17 bits is a tenth of it."""


def closest(
    changes: Callable[[float], list[np.ndarray]], y: np.ndarray, basis: np.ndarray
) -> float:
    """Find the lag [s] whose change of the torque, unscaled, best fits y (M,), measured minus
    predicted, beside the orthonormal ``basis`` (M, K). ``changes`` go from a time [s] to the change
    of the torque (M,), then columns (M,) to fit freely."""

    def left(time: float) -> float:
        change, *free = changes(time)
        both = np.column_stack([y - change, *free])
        off, *others = (both - basis @ (basis.T @ both)).T
        for column in others:
            off = off - column * float(off @ column) / max(float(column @ column), 1e-300)
        return float(off @ off)

    best = int(np.argmin([left(float(t)) for t in TIMES]))
    low, high = TIMES[max(best - 1, 0)], TIMES[min(best + 1, len(TIMES) - 1)]
    minimum = scipy.optimize.minimize_scalar(
        left, bounds=(low, high), method="bounded", options={"xatol": _CLOSE}
    )
    return float(minimum.x)


class Lag(DriveEffect):
    """Delay or filter of the effort; its size is a lag [s], linearised about `Block.value` [s].

    Friction changes sign within an unstated distance after each reversal: a free column.
    """

    one_way = True

    @abstractmethod
    def change(self, rows: DriveRows, torque: np.ndarray, time: float) -> np.ndarray:
        """Change (N,) of a torque (N,) when it is delayed or filtered by a time [s]."""

    def scan(
        self, rows: DriveRows, residual: DriveResidual
    ) -> tuple[tuple[Column, ...], Block] | None:
        turn = direction(rows.speed, TURNS) - rows.sign
        late = [rows.total + rows.level * turn, turn] if rows.command is None else [rows.lagging]

        def changes(time: float) -> list[np.ndarray]:
            return [residual.thin(self.change(rows, x, time))[residual.use] for x in late]

        time = closest(changes, residual.y[residual.use], residual.basis)
        columns = tuple(
            rows.column(word, self.change(rows, x, time) / time)
            for word, x in zip((self.name, f"turn.{self.name}"), late, strict=False)
        )
        names = (*(f"{word}.{rows.joint}" for word in self.beside), *(c.name for c in columns))
        return columns, self.cause(rows, names, time, -float(np.log(len(TIMES))))
