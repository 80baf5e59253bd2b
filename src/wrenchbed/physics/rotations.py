"""Rotations that accept real and complex arrays and jets, shape (…) → (…, 3, 3).

`R_a_b` maps coordinates in frame b to frame a. Euler angles follow the MedRUE paper:
R(α, β, γ) = Rx(γ) Ry(β) Rz(α). Quaternions are w, x, y, z.
"""

import math

import numpy as np

from wrenchbed.physics.taylor_jets import Value, cos, reshape_matrix, sin, stack_jets

_TERMS = 18
"""Terms of the series of sin φ/φ, φ²ᵏ/(2k + 1)!: at φ = π the first omitted one, 6e-26, is below
rounding."""


def rot_x(angle: Value) -> Value:
    return rot_x_of(cos(angle), sin(angle))


def rot_y(angle: Value) -> Value:
    return rot_y_of(cos(angle), sin(angle))


def rot_z(angle: Value) -> Value:
    return rot_z_of(cos(angle), sin(angle))


def rot_x_of(c: Value, s: Value) -> Value:
    """Rotation matrices (…, 3, 3) about x from cosine and sine (…) of the angle."""
    return reshape_matrix(stack_jets([1.0, 0.0, 0.0, 0.0, c, -s, 0.0, s, c]))


def rot_y_of(c: Value, s: Value) -> Value:
    """Rotation matrices (…, 3, 3) about y from cosine and sine (…) of the angle."""
    return reshape_matrix(stack_jets([c, 0.0, s, 0.0, 1.0, 0.0, -s, 0.0, c]))


def rot_z_of(c: Value, s: Value) -> Value:
    """Rotation matrices (…, 3, 3) about z from cosine and sine (…) of the angle."""
    return reshape_matrix(stack_jets([c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0]))


def euler(alpha: Value, beta: Value, gamma: Value) -> Value:
    """Matrices (…, 3, 3) Rx(γ) Ry(β) Rz(α), angles [rad] (Joubair et al. 2016, doi
    10.3390/s16060798)."""
    return rot_x(gamma) @ rot_y(beta) @ rot_z(alpha)


def euler_rates(alpha: float, beta: float, gamma: float) -> np.ndarray:
    """Matrix (3, 3) from the rates (α̇, β̇, γ̇) of `euler`'s angles to angular velocity in body
    axes."""
    inner = rot_y(beta) @ rot_z(alpha)
    return np.stack([np.eye(3)[2], rot_z(alpha).T[:, 1], inner.T[:, 0]], axis=-1)


def exp(x: Value, y: Value, z: Value) -> Value:
    """Rotation matrices (…, 3, 3) by vectors (x, y, z) [rad] (Rodrigues), analytic also at zero."""
    square = x * x + y * y + z * z
    a, b = _series(square, 0), _series(square, 1)
    return reshape_matrix(
        stack_jets(
            [
                1.0 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y,
                b * x * y + a * z, 1.0 - b * (x * x + z * z), b * y * z - a * x,
                b * x * z - a * y, b * y * z + a * x, 1.0 - b * (x * x + y * y),
            ]
        )
    )  # fmt: skip


def _series(square: Value, odd: int) -> Value:
    """Series (…) in ``square`` φ² (…) of sin(φ)/φ (``odd`` 0) or (1 − cos φ)/φ² (``odd`` 1), to
    rounding for |φ| ≤ π."""
    total: Value = 1.0 / (1 + odd) + 0.0 * square
    term: Value = total
    for k in range(1, _TERMS):
        term = term * square * (-1.0 / ((2 * k + odd) * (2 * k + odd + 1)))
        total = total + term
    return total


def apply(matrix: Value, vector: Value) -> Value:
    """Vectors (…, 3) rotated by matrices (…, 3, 3)."""
    return (matrix @ vector[..., None])[..., 0]


def quaternion(matrix: np.ndarray) -> np.ndarray:
    """Quaternion w, x, y, z (4,), w ≥ 0, of a rotation matrix (3, 3).

    By the largest of four expressions (Shepperd 1978, doi 10.2514/3.55767b); the same to the last
    bit as scipy's `Rotation`, which takes twenty times as long.
    """
    (a, b, c), (d, e, f), (g, h, i) = np.asarray(matrix, dtype=float).tolist()
    trace = a + e + i
    candidates = {
        0: (h - f, 1.0 - trace + 2.0 * a, d + b, g + c),
        1: (c - g, d + b, 1.0 - trace + 2.0 * e, h + f),
        2: (d - b, g + c, h + f, 1.0 - trace + 2.0 * i),
        3: (1.0 + trace, h - f, c - g, d - b),
    }
    w, x, y, z = candidates[int(np.argmax([a, e, i, trace]))]
    size = math.sqrt(x * x + y * y + z * z + w * w)
    positive = (w or x or y or z) > 0.0
    return np.array([w, x, y, z]) / (size if positive else -size)


def matrix(quaternion_wxyz: np.ndarray) -> np.ndarray:
    """Rotation matrices (…, 3, 3) of quaternions w, x, y, z (…, 4)."""
    q = np.asarray(quaternion_wxyz, dtype=float)
    w, x, y, z = np.moveaxis(q / np.linalg.norm(q, axis=-1, keepdims=True), -1, 0)
    columns = [
        x * x - y * y - z * z + w * w, 2.0 * (x * y - z * w), 2.0 * (x * z + y * w),
        2.0 * (x * y + z * w), -x * x + y * y - z * z + w * w, 2.0 * (y * z - x * w),
        2.0 * (x * z - y * w), 2.0 * (y * z + x * w), -x * x - y * y + z * z + w * w,
    ]  # fmt: skip
    return np.stack(columns, axis=-1).reshape(*q.shape[:-1], 3, 3)


def rotation_vector(quaternion_wxyz: np.ndarray) -> np.ndarray:
    """Rotation vector (3,) [rad], at most π long, of a quaternion (4,), of unit length or not."""
    w, *xyz = quaternion_wxyz * (-1.0 if quaternion_wxyz[0] < 0.0 else 1.0)
    length = float(np.linalg.norm(xyz))
    return np.array(xyz) * (2.0 * np.arctan2(length, w) / length if length else 0.0)


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product (…, 3) over the last axis; numpy's takes ten times as long on small arrays."""
    return np.stack(
        [
            a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1],
            a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2],
            a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0],
        ],
        axis=-1,
    )


def sphere(count: int) -> np.ndarray:
    """Evenly spaced unit vectors (count, 3) on a golden spiral, by definition of step π(1 + √5)."""
    k = np.arange(count) + 0.5
    z, turn = 1.0 - 2.0 * k / count, np.pi * (1.0 + np.sqrt(5.0)) * k
    flat = np.sqrt(1.0 - z**2)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)
