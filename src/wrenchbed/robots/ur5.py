"""Universal Robots UR5 (CB3) with an ATI Gamma: data and inverse kinematics.

Kinematics: the manufacturer's Denavit–Hartenberg parameters (CB3 manual, table "UR5 serie 3").
Masses and CoGs: Universal Robots, "Parameters for calculations of kinematics and dynamics", there
in the axes at a link's end, here in those at its joint, as in ``models/ur5/ur5.xml``. Flange: the
housing of an ATI Gamma.

Inverse kinematics: the three middle joint axes are parallel, so joints 1, 5 and 6 follow from the
flange's pose, and joints 2 to 4 from a triangle: Hawkins 2013, "Analytic inverse kinematics for the
Universal Robots UR-5/UR-10 arms" (hdl.handle.net/1853/50782).
"""

from itertools import product

import numpy as np

from wrenchbed.physics.gravity import BodyMass
from wrenchbed.physics.rotations import rot_x, rot_z
from wrenchbed.robots.serial_arm import ArmData, Link, SerialArm

_A = (0.0, -0.425, -0.39225, 0.0, 0.0, 0.0)
_D = (0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823)
_ALPHA = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)
_BODIES = (
    BodyMass("shoulder", 3.7, (0.0, -0.00193, 0.063549)),
    BodyMass("upper_arm", 8.393, (-0.2125, 0.0, 0.11336)),
    BodyMass("forearm", 2.33, (-0.24225, 0.0, 0.0265)),
    BodyMass("wrist_1", 1.219, (0.0, -0.01634, 0.10735)),
    BodyMass("wrist_2", 1.219, (0.0, 0.01634, 0.09285)),
    BodyMass("wrist_3", 0.1879, (0.0, 0.0, 0.081141)),
)
_SAMPLED = ((-np.pi, np.pi), (-2.6, -0.5), (-2.4, 2.4), *[(-np.pi, np.pi)] * 3)
"""Elbow up [rad]."""
LIMIT = 6.2832
"""±360° at every joint: Universal Robots, UR5 technical specifications, no. 110105 [rad]."""
TOP_SPEED = np.pi
"""180°/s at every joint: the same specifications [rad/s]."""
GEAR_RATIO = 101.0
"""Of Universal Robots' strain wave gears, equal at every joint."""

ARM = ArmData(
    name="ur5",
    title="Universal Robots UR5 (CB3) with an ATI Gamma",
    sensor="ati-gamma",
    links=tuple(
        Link(a, d, alpha, body, -LIMIT, LIMIT, TOP_SPEED, sampled, GEAR_RATIO)
        for a, d, alpha, body, sampled in zip(_A, _D, _ALPHA, _BODIES, _SAMPLED, strict=True)
    ),
    flange=BodyMass("flange", 0.255, (0.0, 0.0, 0.0167)),
    home=(0.0, -1.2, -1.9, -1.6, 1.5708, 0.0),
    # the example tool: a 1.35 kg cylinder of 40 mm radius and 140 mm length, a little off centre
    tool_mass=1.35,
    tool_cog=(0.004, -0.006, 0.071),
    tool_inertia=(2.7e-3, 2.7e-3, 1.1e-3, 0.0, 0.0, 0.0),
    limbs=(
        ((1, 0.0, 0.13585), (1, _A[1], 0.13585)),
        ((2, 0.0, 0.0165), (2, _A[2], 0.0165)),
    ),
    wrist=(4, 5),
    tool_axis=(0.0, 0.07, 0.14, 0.2),
    table=0.12,
    column=0.2,
    clearance=0.13,  # the limbs' radii and the tool's
)


class UR5(SerialArm):
    """Universal Robots UR5 (CB3) with an ATI Gamma."""

    def inverse(self, rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
        """All joint values (K, 6), K ≤ 8, in (−π, π], that bring the nominal flange to a pose.

        Args:
            rotation: R_world_flange (3, 3).
            position: of the flange in the world (3,) [m].
        """
        found = []
        wrist = position - _D[5] * rotation[:, 2]
        reach = np.hypot(wrist[0], wrist[1])
        if reach < abs(_D[3]):
            return np.empty((0, 6))
        for shoulder, flip, elbow in product((1.0, -1.0), (1.0, -1.0), (1.0, -1.0)):
            q1 = np.arctan2(wrist[1], wrist[0]) + shoulder * np.arccos(_D[3] / reach) + np.pi / 2
            side = np.array([np.sin(q1), -np.cos(q1), 0.0])
            q5 = flip * np.arccos(np.clip((position @ side - _D[3]) / _D[5], -1.0, 1.0))
            if abs(np.sin(q5)) < _SINGULAR:
                continue
            across = rotation.T @ side
            q6 = np.arctan2(-across[1] / np.sin(q5), across[0] / np.sin(q5))
            arm = _triangle(rotation, position, np.array([q1, q5, q6]), elbow)
            if arm is not None:
                found.append([q1, *arm, q5, q6])
        solutions = np.array(found).reshape(-1, 6)
        return np.asarray(np.pi - np.mod(np.pi - solutions, 2 * np.pi))


_SINGULAR = 1e-9
"""Sine of joint 5 below which joints 4 and 6 turn about one axis."""


def _triangle(
    rotation: np.ndarray, position: np.ndarray, known: np.ndarray, elbow: float
) -> tuple[float, float, float] | None:
    """Joints 2, 3, 4 from joints 1, 5, 6 (3,): the triangle of upper arm and forearm."""
    first, fifth, sixth = (_link(q, i) for q, i in zip(known, (0, 4, 5), strict=True))
    flange = np.eye(4)
    flange[:3, :3], flange[:3, 3] = rotation, position
    middle = np.linalg.inv(first) @ flange @ np.linalg.inv(fifth @ sixth)  # joints 2, 3, 4
    end = middle[:3, 3] - _D[3] * np.array([0.0, 0.0, 1.0])
    x, y = end[0], end[1]
    cosine = (x * x + y * y - _A[1] ** 2 - _A[2] ** 2) / (2 * _A[1] * _A[2])
    if abs(cosine) > 1.0:
        return None
    q3 = elbow * np.arccos(cosine)
    q2 = np.arctan2(y, x) - np.arctan2(_A[2] * np.sin(q3), _A[1] + _A[2] * np.cos(q3))
    total = np.arctan2(middle[1, 0], middle[0, 0])
    return float(q2), float(q3), float(total - q2 - q3)


def _link(q: float, i: int) -> np.ndarray:
    """Homogeneous transform (4, 4) of link i."""
    result = np.eye(4)
    result[:3, :3] = rot_z(q) @ rot_x(_ALPHA[i])
    result[:3, 3] = rot_z(q) @ np.array([_A[i], 0.0, _D[i]])
    return result


ROBOT = UR5(ARM)
