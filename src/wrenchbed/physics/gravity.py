"""What an arm's own weight does: the torque at each joint and the moment at the base."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from wrenchbed.errors import NotFoundError
from wrenchbed.physics.rotations import cross
from wrenchbed.physics.time_derivatives import Jet, Value, value
from wrenchbed.physics.wrench import Tool

_STEP = 1e-6
"""Step of the central differences, relative to max(1, |q|)."""
_INSTANT = 1e-3
"""Step in time of the differences for a centre's acceleration [s]; estimate."""


@dataclass(frozen=True)
class BodyMass:
    """A moving body of a robot's MJCF: mass [kg] and centre of gravity in the body's axes [m]."""

    body: str
    mass: float
    cog: tuple[float, float, float]


class ArmBodies(ABC):
    """Moving bodies that carry a sensor, which carries a tool; all poses at rest.

    Weights take joint values q (N, J) or jets, real parameters theta (P,) and gravity (3,) in world
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

    def push_along(
        self, q: Value, theta: np.ndarray, gravity: np.ndarray, length: int
    ) -> np.ndarray:
        """Push (N,) of all weights at rest along a link: its ``length`` is that number in theta.

        By virtual work, in newtons: Σ m g·∂p/∂L, the joints held; positive under tension.

        Raises:
            NotFoundError: the model of this robot has no masses of links.
        """
        step = np.zeros(len(theta))
        step[length] = _STEP
        fallen = []
        for moved in (theta - step, theta + step):
            mass, centres = self._centres(value(q), moved)
            fallen.append(np.einsum("b,nbi,i->n", mass, centres, gravity))
        return (fallen[1] - fallen[0]) / (2.0 * _STEP)

    def gravity_torque(self, q: Value, theta: np.ndarray, gravity: np.ndarray) -> np.ndarray:
        """Torque or force of weight on each actuated joint (N, J) [N·m or N].

        Σ m (g − a)·∂p/∂q over links, tool and sensor, the loops of a closed chain staying closed;
        a = 0 of poses at rest, and of a motion's jets that of each centre of gravity. Moments of
        inertia about these centres are left out.

        Raises:
            NotFoundError: the model of this robot has no masses of links.
        """
        at = value(q)
        each, _ = self._centres(at[:1], theta)
        pull = each[:, None] * (gravity - self._acceleration(q, theta))  # (N, B, 3)
        result = np.empty(at.shape)
        for j in range(at.shape[1]):
            step = _STEP * np.maximum(1.0, np.abs(at[:, j]))
            pair = np.stack([at, at])
            pair[:, :, j] += step, -step
            _, centres = self._centres(pair.reshape(-1, at.shape[1]), theta)
            up, down = centres.reshape(2, len(at), -1, 3)
            way = pair[0, :, j] - pair[1, :, j]
            result[:, j] = (pull * (up - down)).sum(axis=(1, 2)) / way
        return result

    def base_moment(self, q: Value, theta: np.ndarray, gravity: np.ndarray) -> np.ndarray:
        """Moment of weight on links, tool and sensor about `base_origin` (N, 3) [N·m], world axes.

        Weight is m (g − a), as in `gravity_torque`.

        Raises:
            NotFoundError: the model of this robot has no masses of links.
        """
        each, centres = self._centres(value(q), theta)
        pull = each[:, None] * (gravity - self._acceleration(q, theta))
        return np.asarray(cross(centres - self.base_origin(theta), pull).sum(axis=1))

    def _centres(self, q: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Masses (B + 1,) [kg] and centres in the world (N, B + 1, 3) [m] of all that moves."""
        each, centres = self.links(q, theta)
        mass, moment = self.load_moment(q, theta)
        load = moment[:, None] / mass
        return np.append(each, mass), np.concatenate([centres, load], axis=1)

    def _acceleration(self, q: Value, theta: np.ndarray) -> np.ndarray:
        """Of each centre (N, B + 1, 3) [m/s²], by a central difference along the motion; 0 at rest.

        p(q + ε q̇ + ½ ε² q̈) is p after ε to second order.
        """
        if not isinstance(q, Jet):
            return np.zeros(3)
        e = _INSTANT
        centre = self._centres(q.v, theta)[1]
        later = self._centres(q.v + e * q.d + 0.5 * e**2 * q.dd, theta)[1]
        before = self._centres(q.v - e * q.d + 0.5 * e**2 * q.dd, theta)[1]
        return np.asarray((later - 2.0 * centre + before) / e**2)
