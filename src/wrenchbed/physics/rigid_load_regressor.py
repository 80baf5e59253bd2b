"""Newton–Euler equations of a rigid load as a regressor: linear in its ten inertial parameters.

The ten are φ = m, h = m c (3), J about the sensor's origin (xx yy zz xy xz yz). Atkeson, An &
Hollerbach 1986, doi 10.1177/027836498600500306. Vectors have their components first, (3, …, N), so
that every operation runs along the rows.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wrenchbed.physics.taylor_jets import Jet

Vector = Sequence[np.ndarray] | np.ndarray
"""A vector with its components first: array (3, …), or three arrays (…)."""
INERTIAL = 10
"""Number of inertial parameters of a rigid body."""


class Motion(NamedTuple):
    """Motion of a sensor, in sensor axes, components first (3, …, N).

    Attributes:
        origin: acceleration of the sensor's origin minus gravity [m/s²].
        spin: angular velocity [rad/s].
        turning: angular acceleration [rad/s²].
    """

    origin: np.ndarray
    spin: np.ndarray
    turning: np.ndarray


def motion_of(rotation: Jet, position: Jet, gravity: np.ndarray) -> Motion:
    """Motion of a sensor from jets (with time derivatives) of R_world_sensor (…, N, 3, 3) and of
    its origin (…, N, 3) [m]; gravity (3,) in world axes [m/s²]."""
    to_sensor = np.swapaxes(rotation.v, -1, -2)
    spin = to_sensor @ rotation.d  # [ω]×
    turn = to_sensor @ rotation.dd - spin @ spin  # [ω̇]×
    origin = (to_sensor @ (position.dd - gravity)[..., None])[..., 0]
    return Motion(np.moveaxis(origin, -1, 0), _vee(spin), _vee(turn))


def carried_along(motion: Motion, turn: np.ndarray, shift: np.ndarray) -> Motion:
    """Motion of a frame that a moving one carries: its axes ``turn`` (…, 3, 3) and its origin
    ``shift`` (…, 3) [m] in axes of the moving one."""
    lever = np.moveaxis(shift, -1, 0)
    swing = _cross(motion.spin, _cross(motion.spin, lever))
    pull = _cross(motion.turning, lever)
    origin = [o + a + b for o, a, b in zip(motion.origin, pull, swing, strict=True)]

    def turned(x: Vector) -> np.ndarray:
        rows = [sum(turn[..., i, j] * x[i] for i in range(3)) for j in range(3)]
        return np.stack(np.broadcast_arrays(*rows))

    return Motion(turned(origin), turned(motion.spin), turned(motion.turning))


def twist_of(rotation: Jet, position: Jet) -> np.ndarray:
    """Velocity of the sensor's origin [m/s] and angular velocity [rad/s] in sensor axes (N, 6)."""
    to_own = np.swapaxes(rotation.v, -1, -2)
    slide = (to_own @ position.d[..., None])[..., 0]
    return np.concatenate([slide, np.moveaxis(_vee(to_own @ rotation.d), 0, -1)], axis=-1)


def load(motion: Motion, phi: np.ndarray) -> np.ndarray:
    """Wrench (…, N, 6) [N, N·m] on a sensor in ``motion``, by a body with inertial parameters φ (…,
    10): mass, m·CoG, inertia about the sensor's origin xx yy zz xy xz yz."""
    mass, h, inertia = _split(phi)
    force = [-mass * o for o in motion.origin]
    torque = [-x for x in _cross(h, motion.origin)]
    swing = _cross(motion.spin, h)
    momentum = _times(inertia, motion.spin)
    for parts, more in (
        (force, (_cross(motion.turning, h), _cross(motion.spin, swing))),
        (torque, (_times(inertia, motion.turning), _cross(motion.spin, momentum))),
    ):
        for k in range(3):
            parts[k] = parts[k] - more[0][k] - more[1][k]
    return np.stack(np.broadcast_arrays(*force, *torque), axis=-1)


def regressor(motion: Motion) -> np.ndarray:
    """Matrix Y (N, 6, 10) of a motion: Y φ is the wrench by a body's inertial parameters φ (10,)"""
    return np.moveaxis(load(motion, np.eye(INERTIAL)[:, None]), 0, -1)


def _split(phi: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mass (…), first moment h (3, …) and inertia J (6, …) of parameters φ (…, 10)."""
    parts = np.moveaxis(phi, -1, 0)
    return parts[0], parts[1:4], parts[4:]


def _cross(a: Vector, b: Vector) -> list[np.ndarray]:
    return [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]  # fmt: skip


def _times(inertia: np.ndarray, x: Vector) -> list[np.ndarray]:
    xx, yy, zz, xy, xz, yz = inertia
    return [
        xx * x[0] + xy * x[1] + xz * x[2],
        xy * x[0] + yy * x[1] + yz * x[2],
        xz * x[0] + yz * x[1] + zz * x[2],
    ]


def _vee(skew: np.ndarray) -> np.ndarray:
    return np.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]])
