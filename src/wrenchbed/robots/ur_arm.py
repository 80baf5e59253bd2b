"""What Universal Robots' arms have in common: twists, limits, inverse kinematics.

The three middle joint axes are parallel, so joints 1, 5 and 6 follow from the flange's pose, and
joints 2 to 4 from a triangle: Hawkins 2013, "Analytic inverse kinematics for the Universal Robots
UR-5/UR-10 arms" (hdl.handle.net/1853/50782).
"""

from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from wrenchbed.physics.rotations import rot_x, rot_z
from wrenchbed.robots.serial_arm import Link, SerialArm

if TYPE_CHECKING:
    import mujoco

ALPHA = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)
"""Twists α of every arm's links [rad]."""
LIMIT = 6.2832
"""±360° at every joint: Universal Robots, UR5 technical specifications, no. 110105 [rad]."""
GEAR_RATIO = 101.0
"""Ratio of Universal Robots' strain wave gears, equal at every joint."""
SAMPLED = ((-np.pi, np.pi), (-2.6, -0.5), (-2.4, 2.4), *[(-np.pi, np.pi)] * 3)
"""Ranges of sampled joint values, elbow up [rad]."""
JOINTS = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint",
          "wrist_2_joint", "wrist_3_joint")  # fmt: skip
"""Names of the joints in ROS (ur_robot_driver)."""
_SINGULAR = 1e-9
"""Sine of joint 5 below which joints 4 and 6 turn about one axis."""


class URArm(SerialArm):
    """An arm of Universal Robots with an ATI Gamma."""

    joint_names = JOINTS

    def drawn(self) -> "mujoco.MjSpec":
        """MJCF of the arm from its own file, or without shapes from its data."""
        import mujoco

        from wrenchbed.robots.serial_xml import mjcf_of

        if self.mjcf.is_file():
            return super().drawn()
        return mujoco.MjSpec.from_string(mjcf_of(self.arm))

    def inverse(self, rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
        """Joint values (K, 6), K ≤ 8, in (−π, π], that bring the nominal flange to a pose.

        Args:
            rotation: R_world_flange (3, 3).
            position: of the flange in the world (3,) [m].
        """
        candidates = []
        side_step, end = self.arm.links[3].d, self.arm.links[5].d
        wrist = position - end * rotation[:, 2]
        reach = np.hypot(wrist[0], wrist[1])
        if reach < abs(side_step):
            return np.empty((0, 6))
        for shoulder, flip, elbow in product((1.0, -1.0), (1.0, -1.0), (1.0, -1.0)):
            around = shoulder * np.arccos(side_step / reach) + np.pi / 2
            q1 = np.arctan2(wrist[1], wrist[0]) + around
            side = np.array([np.sin(q1), -np.cos(q1), 0.0])
            q5 = flip * np.arccos(np.clip((position @ side - side_step) / end, -1.0, 1.0))
            if abs(np.sin(q5)) < _SINGULAR:
                continue
            across = rotation.T @ side
            q6 = np.arctan2(-across[1] / np.sin(q5), across[0] / np.sin(q5))
            arm = self._triangle(rotation, position, np.array([q1, q5, q6]), elbow)
            if arm is not None:
                candidates.append([q1, *arm, q5, q6])
        solutions = np.array(candidates).reshape(-1, 6)
        return np.asarray(np.pi - np.mod(np.pi - solutions, 2 * np.pi))

    def _triangle(
        self, rotation: np.ndarray, position: np.ndarray, known: np.ndarray, elbow: float
    ) -> tuple[float, float, float] | None:
        """Joints 2, 3, 4 from joints 1, 5, 6 (3,): the triangle of upper arm and forearm."""
        first, fifth, sixth = (
            _link(q, self.arm.links[i]) for q, i in zip(known, (0, 4, 5), strict=True)
        )
        flange = np.eye(4)
        flange[:3, :3], flange[:3, 3] = rotation, position
        middle = np.linalg.inv(first) @ flange @ np.linalg.inv(fifth @ sixth)  # joints 2, 3, 4
        end = middle[:3, 3] - self.arm.links[3].d * np.array([0.0, 0.0, 1.0])
        x, y, upper, fore = end[0], end[1], self.arm.links[1].a, self.arm.links[2].a
        cosine = (x * x + y * y - upper**2 - fore**2) / (2 * upper * fore)
        if abs(cosine) > 1.0:
            return None
        q3 = elbow * np.arccos(cosine)
        q2 = np.arctan2(y, x) - np.arctan2(fore * np.sin(q3), upper + fore * np.cos(q3))
        total = np.arctan2(middle[1, 0], middle[0, 0])
        return float(q2), float(q3), float(total - q2 - q3)


def _link(q: float, link: Link) -> np.ndarray:
    """Homogeneous transform (4, 4) of a link."""
    result = np.eye(4)
    result[:3, :3] = rot_z(q) @ rot_x(link.alpha)
    result[:3, 3] = rot_z(q) @ np.array([link.a, 0.0, link.d])
    return result
