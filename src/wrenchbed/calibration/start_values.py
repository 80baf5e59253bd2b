"""Initial values of a fit: mass, centre of gravity and bias from one linear least squares.

With known orientations a static reading is linear in the mass m, the first moment h = m c and the
six biases, and with independent channels the normal equations are sums over gravity directions.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed.calibration.observations import Observations
from wrenchbed.errors import CalibrationError
from wrenchbed.physics.time_derivatives import Jet
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


def initial_values(
    model: Model, theta: np.ndarray, data: Observations, free: tuple[int, ...]
) -> np.ndarray:
    """The linear solution for mass, CoG and bias, as far as these are free.

    Raises:
        CalibrationError: one orientation only, or a wrench of opposite sign.
    """
    robot, names = model.robot, {model.parameters.names[i] for i in free}
    if not {"sensor.bias.fx", "tool.mass"} <= names or isinstance(data.q, Jet):
        return theta
    gravity = np.asarray(model.gravity)
    seen = robot.gravity_seen(data.q, robot.robot_theta(theta), gravity)
    load = identify_from_gravity(seen, data.wrench)
    if load.mass <= 0 and {f"mount.rotation.{a}" for a in "xyz"} <= names:
        theta = _rotated_mount(model, theta, data, seen, load.mass)
        seen = robot.gravity_seen(data.q, robot.robot_theta(theta), gravity)
        load = identify_from_gravity(seen, data.wrench)
    else:
        check_mass(load.mass)
    tool = robot.theta_of_tool(robot.robot_theta(theta), load.mass, list(load.cog))
    known = np.concatenate([tool, load.bias, theta[len(tool) + len(load.bias) :]])
    start = theta.copy()
    start[list(free)] = known[list(free)]
    return start


def _rotated_mount(
    model: Model, theta: np.ndarray, data: Observations, g: np.ndarray, mass: float
) -> np.ndarray:
    """The sensor's mount rotated to where forces and gravity agree best; reflections are refused.

    Orthogonal Procrustes problem: Schönemann 1966, doi 10.1007/BF02289451.
    """
    force = data.wrench[:, :3]
    link = np.linalg.lstsq(g - g.mean(axis=0), force - force.mean(axis=0), rcond=1e-6)[0]
    if not np.linalg.det(link) > 0:
        check_mass(mass)
    u, _, vt = np.linalg.svd(link)
    names = [f"mount.rotation.{a}" for a in "xyz"]
    stated = Rotation.from_rotvec([theta[model.parameters.index(name)] for name in names])
    rotation = (stated * Rotation.from_matrix(u @ vt)).as_rotvec()
    values = {name: float(v) for name, v in zip(names, rotation, strict=True)}
    return model.parameters.vector(values, start=theta)


def check_mass(mass: float) -> None:
    """Refuse a tool that would weigh nothing or less.

    Raises:
        CalibrationError: the wrench or the gravity has the opposite sign.
    """
    if not mass > 0:
        raise CalibrationError(
            f"the tool's mass comes out as {mass:.4g} kg: the wrench or the gravity has the "
            "opposite sign (wanted: the load on the sensor, +m·g along gravity at rest)"
        )
