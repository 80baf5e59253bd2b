"""Torque at each joint and moment at the base that an arm's own weight causes."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from wrenchbed.errors import NotFoundError
from wrenchbed.physics.rotations import cross
from wrenchbed.physics.taylor_jets import STEP, Jet, Value, stack_jets, transposed, value
from wrenchbed.physics.wrench import Tool


@dataclass(frozen=True)
class BodyMass:
    """Mass [kg] and centre of gravity in body axes [m] of one moving body, named as in the MJCF."""

    body: str
    mass: float
    cog: tuple[float, float, float]


class ArmBodies(ABC):
    """Base class of robots with weight: moving links that carry a sensor, which carries a tool.

    Methods take joint values q (N, J), or a `Jet` of them (with speeds and accelerations),
    parameter values theta (P,) and gravity (3,) in world axes [m/s²].
    """

    name: str
    gear_ratio: tuple[float, ...] = ()
    """Motor turns per turn of each joint; empty if unknown."""

    @abstractmethod
    def sensor_pose(self, q: Value, theta: np.ndarray) -> tuple[Value, Value]:
        """Rotation R_world_sensor (…, N, 3, 3) and sensor's origin in the world (…, N, 3) [m]."""

    @abstractmethod
    def tool(self, theta: np.ndarray) -> Tool:
        """Tool that the sensor carries, with the part of the sensor that loads its gauges."""

    def links(self, q: Value, theta: np.ndarray) -> tuple[np.ndarray, list[Value]]:
        """Masses (B,) [kg] and centres of gravity in the world, a list of B arrays (N, 3) [m], of
        the moving bodies; a `NotFoundError` if the model of this robot has no masses of links."""
        raise NotFoundError(f"robot {self.name!r} has no masses of links in its model")

    def base_origin(self, theta: np.ndarray) -> np.ndarray:
        """The base's origin in the world (3,) [m]."""
        return np.zeros(3)

    def push_along(
        self, q: Value, theta: np.ndarray, gravity: np.ndarray, length: int
    ) -> np.ndarray:
        """Axial force (N,) [N] that all weights put on a link at rest, positive under tension.

        By virtual work with the joints held, Σ m g·∂p/∂L: p are the centres of gravity, L the
        link's length, at index ``length`` of theta.

        Raises:
            NotFoundError: the model of this robot has no masses of links.
        """
        longer = theta.astype(complex)
        longer[length] += 1j * STEP
        mass, centres = self._centres(value(q), longer)
        return np.asarray(np.einsum("b,nbi,i->n", mass, centres.imag / STEP, gravity))

    def gravity_torque(self, q: Value, theta: np.ndarray, gravity: np.ndarray) -> np.ndarray:
        """Torque or force of weight on each actuated joint (N, J) [N·m or N].

        Σ m (g − a)·∂p/∂q over links, tool and sensor, with the loops of a closed chain kept closed.
        a is the acceleration of each centre of gravity, 0 at rest. Moments of inertia about these
        centres are left out.

        Raises:
            NotFoundError: the model of this robot has no masses of links.
        """
        at, (pull, _) = value(q), self._pull(q, theta, gravity)
        result = np.empty(at.shape)
        for j in range(at.shape[1]):
            turned = at.astype(complex)
            turned[:, j] += 1j * STEP
            _, centres = self._centres(turned, theta)
            result[:, j] = (pull * centres.imag / STEP).sum(axis=(1, 2))
        return result

    def base_moment(self, q: Value, theta: np.ndarray, gravity: np.ndarray) -> np.ndarray:
        """Moment of weight on links, tool and sensor about `base_origin` (N, 3) [N·m], world axes.
        Weight is m (g − a), as in `gravity_torque`. A `NotFoundError` if the model has no masses of
        links."""
        pull, centres = self._pull(q, theta, gravity)
        return np.asarray(cross(centres - self.base_origin(theta), pull).sum(axis=1))

    def _pull(
        self, q: Value, theta: np.ndarray, gravity: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Weights m (g − a) [N], a the acceleration, of B moving bodies and their positions in the
        world [m], each (N, B, 3)."""
        mass, centres = self._centres(q, theta)
        acceleration = centres.dd if isinstance(centres, Jet) else 0.0
        return mass[:, None] * (gravity - acceleration), value(centres)

    def _centres(self, q: Value, theta: np.ndarray) -> tuple[np.ndarray, Value]:
        """Masses (B,) [kg] and centres in the world (N, B, 3) [m] of the moving bodies, last the
        tool with the part of the sensor that loads its gauges."""
        masses, centres = self.links(q, theta)
        rotation, origin = self.sensor_pose(q, theta)
        tool = self.tool(theta)
        mass = tool.mass + tool.sensor_mass
        load = origin + rotation @ (tool.mass / mass * tool.cog)
        return np.append(masses, mass.real), transposed(stack_jets([*centres, load]))
