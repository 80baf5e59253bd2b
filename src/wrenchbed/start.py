"""Where a fit begins: the closed-form solution for mass, centre of gravity and bias."""

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed.errors import CalibrationError
from wrenchbed.identify import identify_seen
from wrenchbed.jets import Jet
from wrenchbed.model import Model
from wrenchbed.observations import Observations


def begin(model: Model, theta: np.ndarray, data: Observations, free: tuple[int, ...]) -> np.ndarray:
    """Begin at the linear solution for mass, CoG and bias, as far as these are free."""
    names = {model.parameters.names[i] for i in free}
    if not {"sensor.bias.fx", "tool.mass"} <= names or isinstance(data.q, Jet):
        return theta
    n = len(model.robot.parameters)
    gravity = np.asarray(model.gravity)
    seen = model.robot.gravity_seen(data.q, theta[:n], gravity)
    load = identify_seen(seen, data.wrench)
    if load.mass <= 0:
        if not {f"mount.rotation.{a}" for a in "xyz"} <= names:
            raise opposite(load.mass)
        theta = _turned(model, theta, data, seen, load.mass)
        load = identify_seen(model.robot.gravity_seen(data.q, theta[:n], gravity), data.wrench)
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
