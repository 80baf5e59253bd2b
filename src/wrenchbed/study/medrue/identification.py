"""Identification as the paper does it, and as the noise asks for."""

from dataclasses import dataclass

import numpy as np

from wrenchbed.gauss_newton import solve
from wrenchbed.study.medrue.setting import Setting

_STOP = 1e-12
"""RMS change of the parameters in the paper's units; its 1e-16 lies below rounding (1e-13)."""
_MOST = 30


@dataclass(frozen=True, eq=False)
class Identified:
    """Parameters (P,), Newton steps, and the RMS change of each (in mm, °, kg)."""

    theta: np.ndarray
    steps: int
    changes: tuple[float, ...]


def as_the_paper(
    setting: Setting, q: np.ndarray, wrench: np.ndarray, stop: float = _STOP
) -> Identified:
    """Unweighted normal equations with scaled columns: its Section 4.2, Equations 24–30.

    NaN where the iteration left the region in which the five-bars close.

    Args:
        q: configurations (n, 6).
        wrench: measured means (n, 6) [N, N·m].
        stop: RMS change of the parameters at which the iteration ends.
    """
    model, columns, units = setting.model, list(setting.columns), setting.units
    theta = setting.theta.copy()
    changes: list[float] = []
    while len(changes) < _MOST:
        j = model.jacobian(q, theta, columns).reshape(-1, len(columns)) * units
        r = (wrench - model.predict(q, theta)).ravel()
        if not np.isfinite(j).all():
            return Identified(np.full_like(theta, np.nan), len(changes), tuple(changes))
        scale = np.linalg.norm(j, axis=0)
        scaled = j / scale
        step = np.linalg.solve(scaled.T @ scaled, scaled.T @ r) / scale
        theta[columns] += step * units
        changes.append(float(np.sqrt(np.mean(step**2))))
        if not changes[-1] > stop or (len(changes) > 3 and changes[-1] > 0.5 * changes[-2]):
            break  # done, at the floor of rounding, or lost
    return Identified(theta, len(changes), tuple(changes))


def weighted(
    setting: Setting,
    q: np.ndarray,
    wrench: np.ndarray,
    std: np.ndarray,
    start: np.ndarray | None = None,
) -> Identified:
    """Each channel by its own standard deviation (6,) of a mean: efficient for normal noise.

    Begins at nominal, or at ``start`` (P,).
    """
    model, columns = setting.model, list(setting.columns)

    def at(x: np.ndarray) -> np.ndarray:
        theta = setting.theta.copy()
        theta[columns] = x
        return theta

    solution = solve(
        lambda x: ((wrench - model.predict(q, at(x))) / std).ravel(),
        lambda x: (model.jacobian(q, at(x), columns) / std[:, None]).reshape(-1, len(columns)),
        (setting.theta if start is None else start)[columns],
        model.parameters.tolerance[columns],
    )
    return Identified(at(solution.x), solution.steps, ())
