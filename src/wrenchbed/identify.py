"""Mass, centre of gravity and bias from readings at rest: one linear least squares, in closed form.

With known orientations a static reading is linear in the mass m, the first moment h = m c and the
six biases, and with independent channels the normal equations are sums over gravity directions.
"""

from dataclasses import dataclass

import numpy as np

from wrenchbed.errors import CalibrationError

_LEVI_CIVITA = np.zeros((3, 3, 3))
for _i, _j, _k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _LEVI_CIVITA[_i, _j, _k], _LEVI_CIVITA[_i, _k, _j] = 1.0, -1.0


@dataclass(frozen=True)
class Load:
    """mass [kg], cog (3,) [m] in sensor axes from its origin, bias (6,) [N, N·m]."""

    mass: float
    cog: np.ndarray
    bias: np.ndarray


def identify(
    rotation: np.ndarray, wrench: np.ndarray, gravity: np.ndarray, weight: np.ndarray | None = None
) -> Load:
    """Weighted least squares for mass, centre of gravity and bias.

    Args:
        rotation: R_world_sensor (N, 3, 3).
        wrench: readings at rest (N, 6) [N, N·m].
        gravity: in world axes (3,) [m/s²].
        weight: inverse variance of each channel (6,), equal if None.

    Raises:
        CalibrationError: the orientations cannot separate mass from bias.
    """
    return identify_seen(gravity @ rotation, wrench, weight)


def identify_seen(g: np.ndarray, wrench: np.ndarray, weight: np.ndarray | None = None) -> Load:
    """`identify` from gravity in sensor axes.

    Args:
        g: gravity in sensor axes (N, 3) [m/s²].
        wrench: readings at rest (N, 6) [N, N·m].
        weight: inverse variance of each channel (6,), equal if None.

    Raises:
        CalibrationError: the orientations cannot separate mass from bias.
    """
    w = np.ones(6) if weight is None else weight
    y = np.concatenate([g, wrench], axis=1)
    mean = y.sum(axis=0) / len(y)
    mean_g, mean_y = mean[:3], mean[3:]
    y -= mean  # the bias takes the means
    moments = y[:, :3].T @ y  # (3, 9)
    spread, mixed = moments[:, :3], moments[:, 3:]
    share = w[:3] @ spread.diagonal()
    if not share > 1e-12 * np.vdot(g, g) * w[:3].max():
        raise CalibrationError("all poses have one orientation: they cannot tell mass from bias")
    mass = w[:3] @ mixed.diagonal() / share
    # torque_i = ε_ijk h_j g_k, so the normal matrix is Σ_i w_i ε_ija ε_ilb spread_ab
    normal = np.einsum("i,ija,ab,ilb->jl", w[3:], _LEVI_CIVITA, spread, _LEVI_CIVITA)
    right = np.einsum("i,ija,ai->j", w[3:], _LEVI_CIVITA, mixed[:, 3:])
    moment = np.linalg.lstsq(normal, right, rcond=1e-10)[0]
    bias = mean_y.copy()
    bias[:3] -= mass * mean_g
    bias[3:] -= _LEVI_CIVITA @ mean_g @ moment
    return Load(float(mass), moment / mass, bias)
