"""Mass, centre of gravity and bias from readings at rest: one linear least squares, in closed form.

With known orientations a static reading is linear in the mass m, the first moment h = m c and the
six biases, and with independent channels the normal equations are sums over gravity directions.

Where a fit begins: the closed-form solution for mass, centre of gravity and bias.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed.calibration.observations import Observations
from wrenchbed.errors import CalibrationError
from wrenchbed.physics.taylor import Jet
from wrenchbed.simulation.closed_form import Model

_LEVI_CIVITA = np.zeros((3, 3, 3))
for _i, _j, _k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _LEVI_CIVITA[_i, _j, _k], _LEVI_CIVITA[_i, _k, _j] = 1.0, -1.0


@dataclass(frozen=True)
class IdentifiedLoad:
    """mass [kg], cog (3,) [m] in sensor axes from its origin, bias (6,) [N, N·m]."""

    mass: float
    cog: np.ndarray
    bias: np.ndarray


def identify(
    rotation: np.ndarray, wrench: np.ndarray, gravity: np.ndarray, weight: np.ndarray | None = None
) -> IdentifiedLoad:
    """Weighted least squares for mass, centre of gravity and bias.

    Args:
        rotation: R_world_sensor (N, 3, 3).
        wrench: readings at rest (N, 6) [N, N·m].
        gravity: in world axes (3,) [m/s²].
        weight: inverse variance of each channel (6,), equal if None.

    Raises:
        CalibrationError: the orientations cannot separate mass from bias.
    """
    return identify_from_gravity(gravity @ rotation, wrench, weight)


def identify_from_gravity(
    g: np.ndarray, wrench: np.ndarray, weight: np.ndarray | None = None
) -> IdentifiedLoad:
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
    return IdentifiedLoad(float(mass), moment / mass, bias)


def begin(model: Model, theta: np.ndarray, data: Observations, free: tuple[int, ...]) -> np.ndarray:
    """Begin at the linear solution for mass, CoG and bias, as far as these are free."""
    names = {model.parameters.names[i] for i in free}
    if not {"sensor.bias.fx", "tool.mass"} <= names or isinstance(data.q, Jet):
        return theta
    n = len(model.robot.parameters)
    gravity = np.asarray(model.gravity)
    seen = model.robot.gravity_seen(data.q, theta[:n], gravity)
    load = identify_from_gravity(seen, data.wrench)
    if load.mass <= 0:
        if not {f"mount.rotation.{a}" for a in "xyz"} <= names:
            raise opposite(load.mass)
        theta = _turned(model, theta, data, seen, load.mass)
        load = identify_from_gravity(
            model.robot.gravity_seen(data.q, theta[:n], gravity), data.wrench
        )
    start = theta.copy()
    start[:n] = model.robot.theta_of_tool(theta[:n], load.mass, list(load.cog))
    start[n : n + 6] = load.bias
    held = [i for i in range(len(theta)) if i not in free]
    start[held] = theta[held]
    return start


def _turned(
    model: Model, theta: np.ndarray, data: Observations, g: np.ndarray, mass: float
) -> np.ndarray:
    """The sensor's mount turned to where forces and gravity agree best; a reflection is refused.

    Orthogonal Procrustes problem: Schönemann 1966, doi 10.1007/BF02289451.
    """
    force = data.wrench[:, :3]
    link = np.linalg.lstsq(g - g.mean(axis=0), force - force.mean(axis=0), rcond=1e-6)[0]
    if not np.linalg.det(link) > 0:
        raise opposite(mass)
    u, _, vt = np.linalg.svd(link)
    names = [f"mount.rotation.{a}" for a in "xyz"]
    stated = Rotation.from_rotvec([theta[model.parameters.index(name)] for name in names])
    turn = (stated * Rotation.from_matrix(u @ vt)).as_rotvec()
    values = {name: float(v) for name, v in zip(names, turn, strict=True)}
    return model.parameters.vector(values, start=theta)


def opposite(mass: float) -> CalibrationError:
    """The error for a tool that would weigh less than nothing."""
    return CalibrationError(
        f"the tool's mass comes out as {mass:.4g} kg: the wrench or the gravity has the opposite "
        "sign (wanted: the load on the sensor, +m·g along gravity at rest)"
    )
