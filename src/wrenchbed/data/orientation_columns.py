"""Orientations in every way that files give them → unit quaternions of the sensor in the base."""

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed.data.column_map import (
    EULER,
    ROLL_PITCH_YAW,
    ROTATION,
    ROTATION_VECTOR,
    Conventions,
)
from wrenchbed.data.recording import QUATERNION
from wrenchbed.errors import MapError

ORTHONORMAL = 1e-3
"""Largest |RᵀR − I| of a rotation matrix; printed with four digits it is about 1e-4."""
UNIT = 1e-2
"""Largest error of a quaternion's length: two digits are enough to see that it is one."""


def turned(data: Mapping[str, np.ndarray], where: str, conventions: Conventions) -> Rotation | None:
    """The orientation (N,) that a file's columns give, as the file means it; None without one.

    Args:
        data: columns (N,), angles in rad.
        where: name of the file, for messages.
        conventions: order of Euler angles.

    Raises:
        MapError: a matrix or quaternion that is no rotation; names the row.
    """
    if QUATERNION[0] in data:
        q = np.stack([data[c] for c in QUATERNION], axis=-1)
        length = np.linalg.norm(q, axis=1)
        bad = np.flatnonzero(~(np.abs(length - 1.0) < UNIT))
        if len(bad):
            raise MapError(
                f"{where}: row {bad[0]}: qw qx qy qz has length {length[bad[0]]:.4g}, "
                "a unit quaternion has 1"
            )
        return Rotation.from_quat(q, scalar_first=True)
    if ROTATION[0] in data:
        return Rotation.from_matrix(_matrices(data, where))
    if ROTATION_VECTOR[0] in data:
        return Rotation.from_rotvec(np.stack([data[c] for c in ROTATION_VECTOR], axis=-1))
    for names, order in ((ROLL_PITCH_YAW, "xyz"), (EULER, conventions.order)):
        if names[0] in data and order is not None:
            return Rotation.from_euler(order, np.stack([data[c] for c in names], axis=-1))
    return None


def _matrices(data: Mapping[str, np.ndarray], where: str) -> np.ndarray:
    matrix = np.stack([data[r] for r in ROTATION], axis=-1).reshape(-1, 3, 3)
    error = np.abs(np.swapaxes(matrix, -1, -2) @ matrix - np.eye(3)).max(axis=(1, 2))
    left = np.linalg.det(matrix) < 0
    bad = np.flatnonzero((error > ORTHONORMAL) | left)
    if len(bad):
        row = bad[0]
        why = "it is left-handed" if error[row] <= ORTHONORMAL else f"RᵀR off by {error[row]:.2g}"
        raise MapError(f"{where}: row {row}: r11…r33 is not a rotation ({why})")
    return matrix


def of_sensor(
    given: Rotation, conventions: Conventions, pose_flange: tuple[float, ...] | None
) -> Rotation:
    """The sensor in the base, from the orientation (N,) as a file means it."""
    rotation = given.inv() if conventions.inverse else given
    if conventions.of == "flange" and pose_flange is not None:
        rotation = rotation * Rotation.from_quat(pose_flange[3:], scalar_first=True)
    return rotation


def columns_of(rotation: Rotation) -> dict[str, np.ndarray]:
    """Quaternion columns qw qx qy qz (N,), qw ≥ 0."""
    q = rotation.as_quat(canonical=True, scalar_first=True)
    return dict(zip(QUATERNION, q.T, strict=True))


def wrench_in_sensor(
    wrench: np.ndarray,
    conventions: Conventions,
    rotation: Rotation | None,
    pose_flange: tuple[float, ...] | None,
) -> np.ndarray:
    """A wrench (N, 6) [N, N·m] in the sensor's axes about its origin.

    Args:
        wrench: in the axes that the conventions name: of the base about the sensor's origin, of
            the flange about the flange's origin.
        conventions: of the file.
        rotation: sensor in base (N,), for a wrench in the base's axes.
        pose_flange: of the sensor, x y z qw qx qy qz, for a wrench in the flange's axes.
    """
    force, torque = wrench[:, :3], wrench[:, 3:]
    if conventions.wrench_axes == "base" and rotation is not None:
        back = rotation.inv()
        return np.concatenate([back.apply(force), back.apply(torque)], axis=1)
    if conventions.wrench_axes == "flange" and pose_flange is not None:
        back = Rotation.from_quat(pose_flange[3:], scalar_first=True).inv()
        about = torque - np.cross(np.asarray(pose_flange[:3]), force)
        return np.concatenate([back.apply(force), back.apply(about)], axis=1)
    return wrench
