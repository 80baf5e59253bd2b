"""Poses as Universal Robots writes them: x y z [m] and a rotation vector rx ry rz [rad].

Plain numbers instead of arrays where a control cycle would feel the difference.
"""

from math import acos, cos, sin, sqrt

import numpy as np

Transform = tuple[np.ndarray, np.ndarray]
"""Rotation (3, 3) and position (3,)."""


def matrix(pose: np.ndarray) -> Transform:
    """Transform of a pose (6,)."""
    x, y, z = pose[3:].tolist()
    angle = sqrt(x * x + y * y + z * z)
    if angle < 1e-12:
        return np.eye(3), np.asarray(pose[:3])
    x, y, z = x / angle, y / angle, z / angle
    c, s = cos(angle), sin(angle)
    v = 1.0 - c
    rotation = np.array([
        [c + v * x * x, v * x * y - s * z, v * x * z + s * y],
        [v * x * y + s * z, c + v * y * y, v * y * z - s * x],
        [v * x * z - s * y, v * y * z + s * x, c + v * z * z],
    ])  # fmt: skip
    return rotation, np.asarray(pose[:3])


def vector(rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Pose (6,)."""
    return np.concatenate([position, rotation_vector(rotation)])


def compose(first: Transform, second: Transform) -> Transform:
    """One transform after the other."""
    return first[0] @ second[0], first[0] @ second[1] + first[1]


def pose_trans(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """URScript's pose_trans of two poses (6,)."""
    return vector(*compose(matrix(first), matrix(second)))


def rotation_vector(r: np.ndarray) -> np.ndarray:
    """Rotation vector (3,) of a matrix, of length ≤ π."""
    (a, b, c), (d, e, f), (g, h, i) = r.tolist()
    trace = a + e + i
    if trace > 2.9999999:
        return np.array([h - f, c - g, d - b]) / 2
    if trace > -0.99:
        angle = acos(min(1.0, (trace - 1) / 2))
        return np.array([h - f, c - g, d - b]) * (angle / (2 * sin(angle)))
    return _near_half_turn(r, trace, np.array([h - f, c - g, d - b]))


def _near_half_turn(r: np.ndarray, trace: float, skew: np.ndarray) -> np.ndarray:
    angle = acos(max(-1.0, (trace - 1) / 2))
    outer = (r + r.T) / 2 - cos(angle) * np.eye(3)
    k = int(np.argmax(np.diag(outer)))
    axis = outer[k] / sqrt(outer[k, k] * (1 - cos(angle)))
    if skew @ axis < 0:
        axis = -axis
    return np.asarray(axis / np.linalg.norm(axis) * angle)
