"""What a rigid tool puts on the sensor: the wrench at rest and in motion, in the sensor's axes.

Sign: the load that the world puts on the sensor's tool side, torque about the sensor's origin.
At rest with the tool hanging below a sensor whose z points down, fz = +m g.
Newton–Euler equations: Siciliano et al., Robotics (2009), Section 7.5.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchbed.physics.rigid_load_regressor import load, motion_of
from wrenchbed.physics.rotations import cross
from wrenchbed.physics.taylor_jets import Jet, Value

CHANNELS = ("fx", "fy", "fz", "tx", "ty", "tz")
"""The six channels of a wrench, forces [N] and torques [N·m]."""
UNITS = ("N", "N", "N", "N·m", "N·m", "N·m")


@dataclass(frozen=True, eq=False)
class Tool:
    """A rigid load on the sensor; shapes broadcast against a batch of parameter vectors.

    Attributes:
        mass: (…) [kg].
        cog: centre of gravity (…, 3) in sensor axes from the sensor's origin [m].
        inertia: (…, 3, 3) about the centre of gravity in sensor axes [kg·m²].
        sensor_mass: (…) the part of the sensor's mass that loads its gauges, at its origin [kg].
    """

    mass: np.ndarray
    cog: np.ndarray
    inertia: np.ndarray
    sensor_mass: np.ndarray

    @property
    def lever(self) -> np.ndarray:
        """Matrix [c]× (…, 3, 3) [m] that turns a force at the centre of gravity into its torque."""
        return np.swapaxes(cross(self.cog[..., None, :], np.eye(3)), -1, -2)

    @property
    def inertial(self) -> np.ndarray:
        """Parameters (…, 10): mass with the sensor's, m·CoG, inertia about the origin xx yy zz xy
        xz yz."""
        cx, cy, cz = (self.cog[..., k] for k in range(3))
        m, about = self.mass, self.inertia
        six = [about[..., i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
        steiner = (
            cy * cy + cz * cz, cx * cx + cz * cz, cx * cx + cy * cy, -cx * cy, -cx * cz, -cy * cz,
        )  # fmt: skip
        second = [a + m * b for a, b in zip(six, steiner, strict=True)]
        parts = [m + self.sensor_mass, m * cx, m * cy, m * cz, *second]
        return np.stack(np.broadcast_arrays(*parts), axis=-1)


def about_centre(phi: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mass [kg], CoG (3,) [m], inertia about it (3, 3) [kg·m²] from inertial parameters φ (10,)."""
    mass, cog = phi[0], phi[1:4] / phi[0]
    return mass, cog, symmetric(phi[4:]) - mass * (cog @ cog * np.eye(3) - np.outer(cog, cog))


def wrench(rotation: Value, position: Value, tool: Tool, gravity: np.ndarray) -> np.ndarray:
    """Load on the sensor (…, N, 6) [N, N·m]; at rest for arrays, Newton–Euler for `Jet`s.

    Args:
        rotation: R_world_sensor (…, N, 3, 3).
        position: the sensor's origin in the world (…, N, 3) [m]; only its acceleration matters.
        gravity: (3,) in world axes [m/s²].
    """
    if isinstance(rotation, Jet):
        return load(motion_of(rotation, position, gravity), tool.inertial)
    return weight(np.swapaxes(rotation, -1, -2) @ gravity, tool)


def weight(seen: np.ndarray, tool: Tool) -> np.ndarray:
    """Load on the sensor (…, N, 6) [N, N·m] at rest, for gravity ``seen`` in its axes (…, N, 3)."""
    force, side_force = (np.asarray(m)[..., None] * seen for m in (tool.mass, tool.sensor_mass))
    return np.concatenate(np.broadcast_arrays(force + side_force, cross(tool.cog, force)), axis=-1)


def symmetric(six: Sequence[float] | np.ndarray) -> np.ndarray:
    """Symmetric matrix (3, 3) from its six numbers xx yy zz xy xz yz."""
    xx, yy, zz, xy, xz, yz = six
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def six_of(inertia: np.ndarray) -> np.ndarray:
    """Six numbers xx yy zz xy xz yz (6,) of a symmetric matrix (3, 3)."""
    return inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def physical_inertia(inertia: Sequence[float] | np.ndarray) -> bool:
    """Whether xx yy zz xy xz yz [kg·m²] can be a body's: principal moments ≥ 0 with A + B ≥ C."""
    a, b, c = np.linalg.eigvalsh(symmetric(inertia))
    slack = 1e-9 * max(abs(c), 1e-12)
    return bool(a >= -slack and a + b >= c - slack)


def of_mass(place: np.ndarray) -> np.ndarray:
    """Inertial parameters (10,), mass and its moments, of 1 kg at a place (3,) [m]."""
    return np.array([1.0, *place, *six_of(_second(place, place))])


def of_moment(place: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Change of inertial parameters (10,) as a mass at a place (3,) [m] moves along a unit vector
    ``way`` (3,), per 1 kg·m of mass times distance."""
    return np.array([0.0, *way, *six_of(2.0 * _second(place, way))])


def _second(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(a·b) 1 − (a bᵀ + b aᵀ)/2 (3, 3): with a = b the inertia of a unit mass at place a (3,)."""
    return np.asarray((a @ b) * np.eye(3) - 0.5 * (np.outer(a, b) + np.outer(b, a)))
