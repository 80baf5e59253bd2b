"""Surfaces that a tool's tip presses on: forces by formulas, as MuJoCo states no N/m."""

from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np

from wrenchbed.errors import ParameterError
from wrenchbed.robots.base import Robot

_TIP = np.array([0.0, 0.0, 0.14])
"""Tip in sensor axes [m] of a robot that states none: the end of UR5's example tool."""
_CREEP = 1e-3
"""Speed at which friction is three quarters of its full size [m/s]."""


class Surface(Protocol):
    """Surface that pushes back on the tool's tip."""

    def push(self, tip: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Force (3,) [N] on a tip at (3,) [m] that moves with a velocity (3,) [m/s], world axes."""


@dataclass(frozen=True)
class Plate:
    """A horizontal plate with its top at a height [m] that pushes straight up as a spring [N/m]; a
    `ParameterError` if the height is not finite."""

    height: float
    stiffness: float = 2e4

    def __post_init__(self) -> None:
        if not np.isfinite(self.height):
            raise ParameterError(f"table = {self.height} must be a height [m]")

    def push(self, tip: np.ndarray, speed: np.ndarray) -> np.ndarray:
        return np.array([0.0, 0.0, self.stiffness * max(0.0, self.height - tip[2])])


@dataclass(frozen=True, eq=False)
class Limb:
    """A compliant cylinder with Hunt-Crossley contact (1975) and friction, in world axes.

    Attributes:
        point: a point on its axis (3,) [m].
        axis: unit vector (3,).
        radius: [m].
        stiffness: [N/m].
        damping: relative rise of the spring's force per unit of speed [s/m].
        friction: coefficient of Coulomb friction.
    """

    point: np.ndarray
    axis: np.ndarray
    radius: float
    stiffness: float
    damping: float = 1.0
    friction: float = 0.2

    def push(self, tip: np.ndarray, speed: np.ndarray) -> np.ndarray:
        away = tip - self.point
        away = away - self.axis * (away @ self.axis)
        distance = float(np.sqrt(away @ away))
        depth = self.radius - distance
        if depth <= 0.0 or distance == 0.0:
            return np.zeros(3)
        normal = away / distance
        closing = -float(speed @ normal)
        force = max(0.0, self.stiffness * depth * (1.0 + self.damping * closing))
        slide = speed + closing * normal
        drag = np.tanh(np.sqrt(slide @ slide) / _CREEP)
        along = slide / max(float(np.sqrt(slide @ slide)), 1e-12)
        return np.asarray(force * (normal - self.friction * drag * along))


def tip_in(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Position (3,) [m] of the tool's tip in the world, at the state of MuJoCo's ``data``."""
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, "tcp")
    if site >= 0:
        return np.array(data.site_xpos[site])
    sensor = model.site("ft").id
    return np.asarray(data.site_xpos[sensor] + data.site_xmat[sensor].reshape(3, 3) @ _TIP)


def tip_of(robot: Robot, q: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tool's orientation (N, 3, 3), tip (N, 3) [m] in the world, at q (N, J), parameters theta
    (P,)."""
    if type(robot).tool_pose is Robot.tool_pose:
        rotation, origin = robot.sensor_pose(q, theta)
        return rotation, origin + rotation @ _TIP
    return robot.tool_pose(q, theta)
