"""Turns of a robot's base and of its sensor, written into whichever parameters the robot has."""

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed.frames import euler, exp
from wrenchbed.robots.base import Robot


def turn_base(robot: Robot, theta: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Parameters (P,) after gravity, as the base sees it, has turned by a vector (3,) [rad].

    A turn about the vertical is lost on robots whose base has a tilt only; no wrench shows it.
    """
    names = robot.parameters.names
    if "base.tilt.x" in names:
        at = [names.index(f"base.tilt.{a}") for a in "xy"]
        before = exp(theta[at[0]], theta[at[1]], 0.0)
        after = Rotation.from_matrix(exp(*vector) @ before).as_rotvec()
        return _put(theta, at, after[:2])
    at = [names.index(n) for n in ("alpha0", "beta0", "gamma0")]
    return _put(theta, at, angles(exp(*-vector) @ euler(*theta[at])))


def turn_sensor(robot: Robot, theta: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Parameters (P,) after the sensor has turned on its flange by a vector (3,) in its axes."""
    names = robot.parameters.names
    if "mount.rotation.x" in names:
        at = [names.index(f"mount.rotation.{a}") for a in "xyz"]
        return _put(theta, at, Rotation.from_matrix(exp(*theta[at]) @ exp(*vector)).as_rotvec())
    at = [names.index(n) for n in ("alphaS", "betaS", "gammaS")]
    tool = robot.tool(theta)
    turned = _put(theta, at, angles(euler(*theta[at]) @ exp(*vector)))
    return robot.theta_of_tool(turned, float(tool.mass), [float(c) for c in tool.cog])


def angles(rotation: np.ndarray) -> np.ndarray:
    """α, β, γ of Rx(γ) Ry(β) Rz(α) (3,) [rad]."""
    gamma, beta, alpha = Rotation.from_matrix(rotation).as_euler("XYZ")
    return np.array([alpha, beta, gamma])


def _put(theta: np.ndarray, at: list[int], values: np.ndarray) -> np.ndarray:
    result = np.array(theta, dtype=float)
    result[at] = values
    return result
