"""UR5's inverse kinematics in closed form: up to eight solutions.

The three middle joint axes are parallel, so joints 1, 5 and 6 follow from the flange's pose, and
joints 2 to 4 from a triangle: Hawkins 2013, "Analytic inverse kinematics for the Universal Robots
UR-5/UR-10 arms" (hdl.handle.net/1853/50782).
"""

from itertools import product

import numpy as np

from wrenchbed.physics.rotations import rot_x, rot_z

_SINGULAR = 1e-9


def joints(
    a: np.ndarray, d: np.ndarray, alpha: np.ndarray, rotation: np.ndarray, position: np.ndarray
) -> np.ndarray:
    """All joint values (K, 6), K ≤ 8, in (−π, π], that bring the flange to a pose.

    Args:
        a, d, alpha: Denavit–Hartenberg parameters (6,), twists of ±90° as the maker states them.
        rotation: R_base_flange (3, 3).
        position: of the flange in the base (3,) [m].
    """
    found = []
    wrist = position - d[5] * rotation[:, 2]
    reach = np.hypot(wrist[0], wrist[1])
    if reach < abs(d[3]):
        return np.empty((0, 6))
    for shoulder, flip, elbow in product((1.0, -1.0), (1.0, -1.0), (1.0, -1.0)):
        q1 = np.arctan2(wrist[1], wrist[0]) + shoulder * np.arccos(d[3] / reach) + np.pi / 2
        side = np.array([np.sin(q1), -np.cos(q1), 0.0])
        q5 = flip * np.arccos(np.clip((position @ side - d[3]) / d[5], -1.0, 1.0))
        if abs(np.sin(q5)) < _SINGULAR:
            continue
        across = rotation.T @ side
        q6 = np.arctan2(-across[1] / np.sin(q5), across[0] / np.sin(q5))
        arm = _arm(a, d, alpha, rotation, position, np.array([q1, q5, q6]), elbow)
        if arm is not None:
            found.append([q1, *arm, q5, q6])
    return np.array([_wrapped(np.array(q)) for q in found]).reshape(-1, 6)


def _arm(
    a: np.ndarray,
    d: np.ndarray,
    alpha: np.ndarray,
    rotation: np.ndarray,
    position: np.ndarray,
    known: np.ndarray,
    elbow: float,
) -> tuple[float, float, float] | None:
    """Joints 2, 3, 4 from joints 1, 5, 6: the triangle of upper arm and forearm."""
    q1, q5, q6 = known
    first, fifth, sixth = (_link(q, a[i], d[i], alpha[i]) for q, i in ((q1, 0), (q5, 4), (q6, 5)))
    flange = np.eye(4)
    flange[:3, :3], flange[:3, 3] = rotation, position
    middle = np.linalg.inv(first) @ flange @ np.linalg.inv(fifth @ sixth)  # joints 2, 3, 4
    end = middle[:3, 3] - d[3] * np.array([0.0, 0.0, 1.0])
    x, y = end[0], end[1]
    cosine = (x * x + y * y - a[1] ** 2 - a[2] ** 2) / (2 * a[1] * a[2])
    if abs(cosine) > 1.0:
        return None
    q3 = elbow * np.arccos(cosine)
    q2 = np.arctan2(y, x) - np.arctan2(a[2] * np.sin(q3), a[1] + a[2] * np.cos(q3))
    total = np.arctan2(middle[1, 0], middle[0, 0])
    return float(q2), float(q3), float(total - q2 - q3)


def _link(q: float, a: float, d: float, alpha: float) -> np.ndarray:
    """Homogeneous transform (4, 4) of one link."""
    result = np.eye(4)
    result[:3, :3] = rot_z(q) @ rot_x(alpha)
    result[:3, 3] = rot_z(q) @ np.array([a, 0.0, d])
    return result


def _wrapped(q: np.ndarray) -> np.ndarray:
    return np.asarray(np.pi - np.mod(np.pi - q, 2 * np.pi))
