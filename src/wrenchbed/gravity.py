"""What gravity does to an arm itself: the torque at each joint and the moment at the base."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchbed.errors import NotFoundError
from wrenchbed.frames import cross
from wrenchbed.jets import Value
from wrenchbed.wrench import Tool

_STEP = 1e-6
"""Step of the central differences, relative to max(1, |q|)."""


@dataclass(frozen=True)
class Link:
    """A moving body of a robot's MJCF: mass [kg] and centre of gravity in the body's axes [m]."""

    body: str
    mass: float
    cog: tuple[float, float, float]


def masses(links: Sequence[Link]) -> np.ndarray:
    """Masses (B,) [kg], not writable."""
    result = np.array([link.mass for link in links])
    result.setflags(write=False)
    return result


class Arm(ABC):
    """Moving bodies that carry a sensor, which carries a tool; all poses at rest.

    Weights take joint values q (N, J), real parameters theta (P,) and gravity (3,) in world
    axes [m/s²].
    """

    name: str
    gear_ratio: tuple[float, ...] = ()
    """Motor turns per turn of each joint; empty if unknown."""

    @abstractmethod
    def sensor_pose(self, q: Value, theta: np.ndarray) -> tuple[Value, Value]:
        """R_world_sensor (…, N, 3, 3) and the sensor's origin in the world (…, N, 3) [m]."""

    @abstractmethod
    def tool(self, theta: np.ndarray) -> Tool:
        """The load on the sensor."""

    def links(self, q: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Masses (B,) [kg] and centres of gravity in the world (N, B, 3) [m] of the moving bodies.

        All but the tool: the links, and the part of the sensor on the flange's side.

        Raises:
            NotFoundError: the model of this robot has no masses of links.
        """
        raise NotFoundError(f"robot {self.name!r} has no masses of links in its model")

    def base_origin(self, theta: np.ndarray) -> np.ndarray:
        """The base's origin in the world (3,) [m]."""
        return np.zeros(3)

    def load_moment(self, q: np.ndarray, theta: np.ndarray) -> tuple[float, np.ndarray]:
        """Mass [kg] and Σ m p (N, 3) [kg·m] in the world of the tool and the sensor's own mass."""
        rotation, origin = self.sensor_pose(q, theta)
        tool = self.tool(theta)
        mass = float(tool.mass + tool.sensor_mass)
        return mass, mass * origin + rotation @ (tool.mass * tool.cog)

    def gravity_torque(self, q: np.ndarray, theta: np.ndarray, gravity: np.ndarray) -> np.ndarray:
        """Torque or force of gravity on each actuated joint (N, J) [N·m or N].

        −∂U/∂q of links, tool and sensor, the loops of a closed chain staying closed.

        Raises:
            NotFoundError: the model of this robot has no masses of links.
        """
        result = np.empty(q.shape)
        for j in range(q.shape[1]):
            step = _STEP * np.maximum(1.0, np.abs(q[:, j]))
            pair = np.stack([q, q])
            pair[:, :, j] += step, -step
            _, moment = self._moment(pair.reshape(-1, q.shape[1]), theta)
            up, down = (moment @ gravity).reshape(2, -1)
            result[:, j] = (up - down) / (pair[0, :, j] - pair[1, :, j])
        return result

    def base_moment(self, q: np.ndarray, theta: np.ndarray, gravity: np.ndarray) -> np.ndarray:
        """Moment of gravity on links, tool and sensor about `base_origin` (N, 3) [N·m], world axes.

        Raises:
            NotFoundError: the model of this robot has no masses of links.
        """
        mass, moment = self._moment(q, theta)
        return cross(moment - mass * self.base_origin(theta), gravity)

    def _moment(self, q: np.ndarray, theta: np.ndarray) -> tuple[float, np.ndarray]:
        """Mass [kg] and Σ m p (N, 3) [kg·m] in the world of all that moves."""
        each, centres = self.links(q, theta)
        mass, moment = self.load_moment(q, theta)
        return mass + float(each.sum()), moment + each @ centres
