"""Universal Robots' arms with an ATI Gamma, the UR5 (CB3) first, and their inverse kinematics.

Their data are in ``models/universal_robots.toml``, with sources; there CoGs are in the axes at a
link's end, here in those at its joint, as in ``models/ur5/ur5.xml``. Flange: an ATI Gamma's
housing.

Joints turn ±360°: in the maker's manuals; the ROS description has ±180° at the elbow for its
planners. Where poses are sampled is the UR5's, scaled: an estimate.
"""

import tomllib
from functools import cache
from itertools import product

import numpy as np

from wrenchbed.physics.gravity_torques import BodyMass
from wrenchbed.physics.rotations import rot_x
from wrenchbed.robots.arm_numbers import Load
from wrenchbed.robots.base import models
from wrenchbed.robots.serial_arm import ArmData, Link, SerialArm

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
_BODIES = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
_SINGULAR = 1e-9
"""Sine of joint 5 below which joints 4 and 6 turn about one axis."""
_LIMBS = ((1, 0.13585), (2, 0.0165))
"""Numbers of a UR5's links along which limbs lie, and z of the limbs in their joints' axes [m]."""
_UR5_ARM, _UR5_SIDE = -0.425, 0.10915
"""Length of a UR5's upper arm and offset of its wrist [m], to which others' are compared."""
_TABLE, _COLUMN, _CLEARANCE = 0.12, 0.2, 0.13
"""``table``, ``column`` and ``clearance`` of a UR5's `ArmData` [m]; limbs' and tool's radii."""
_PUBLISHED = tomllib.loads((models() / "universal_robots.toml").read_text(encoding="utf-8"))
NAMES = tuple(name for name in _PUBLISHED if name != "ur5")
"""Names of the arms beside the UR5, for `ur_arm`; the UR5 alone has an MJCF file."""


class URArm(SerialArm):
    """A Universal Robots arm with an ATI Gamma at its flange, with inverse kinematics."""

    joint_names = JOINTS

    def inverse(self, rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
        """Inverse kinematics: joint values (K, 6), K ≤ 8, in (−π, π] [rad], for a pose of the
        nominal flange: R_world_flange (3, 3) and position (3,) [m]."""
        height, _, _, step, wrist, end = (link.d for link in self.arm.links)
        _, upper, fore, *_ = (link.a for link in self.arm.links)
        x, y, _ = position - end * rotation[:, 2]
        reach, candidates = np.hypot(x, y), list[list[float]]()
        if reach < abs(step):
            return np.empty((0, 6))
        for shoulder, flip, elbow in product((1.0, -1.0), (1.0, -1.0), (1.0, -1.0)):
            q1 = np.arctan2(y, x) + shoulder * np.arccos(step / reach) + np.pi / 2
            side, ahead = np.array([[np.sin(q1), -np.cos(q1), 0.0], [np.cos(q1), np.sin(q1), 0.0]])
            q5 = flip * np.arccos(np.clip((position @ side - step) / end, -1.0, 1.0))
            if abs(np.sin(q5)) < _SINGULAR:
                continue
            across = rotation.T @ side
            q6 = np.arctan2(-across[1] / np.sin(q5), across[0] / np.sin(q5))
            down = -rotation @ [np.sin(q6), np.cos(q6), 0.0]  # along joint 5's axis
            centre = position - end * rotation[:, 2] - wrist * down - step * side
            u, v = centre @ ahead, centre[2] - height  # the triangle of upper arm and forearm
            cosine = (u * u + v * v - upper**2 - fore**2) / (2 * upper * fore)
            if abs(cosine) > 1.0:
                continue
            q3 = elbow * np.arccos(cosine)
            q2 = np.arctan2(v, u) - np.arctan2(fore * np.sin(q3), upper + fore * np.cos(q3))
            q4 = np.arctan2(down @ ahead, -down[2]) - q2 - q3
            candidates.append([q1, q2, q3, q4, q5, q6])
        solutions = np.array(candidates).reshape(-1, 6)
        return np.asarray(np.pi - np.mod(np.pi - solutions, 2 * np.pi))


@cache
def ur_arm(name: str) -> URArm:
    """Return the UR5, or another arm of `NAMES` by its name, with the same sensor and tool."""
    published = _PUBLISHED[name]
    d1, a2, a3, d4, d5, d6 = published["lengths"]
    table = ((0.0, d1), (a2, 0.0), (a3, 0.0), (0.0, d4), (0.0, d5), (0.0, d6))
    figures = (published[key] for key in ("masses", "cogs", "speeds"))
    links = []
    each = zip(_BODIES, table, ALPHA, SAMPLED, *figures, strict=True)
    for body, (a, d), alpha, sampled, mass, at_end, speed in each:
        cog = rot_x(alpha) @ np.array(at_end) + np.array([a, 0.0, d])
        x, y, z = (float(round(c, 9)) for c in cog)
        top = float(np.deg2rad(speed))
        bodied = BodyMass(body, mass, (x, y, z))
        links.append(Link(a, d, alpha, bodied, -LIMIT, LIMIT, top, sampled, GEAR_RATIO))
    scale, side = a2 / _UR5_ARM, d4 / _UR5_SIDE
    title = name.removeprefix("ur").replace("long", " Long")  # ``ur8long`` is the UR8 Long
    return URArm(
        ArmData(
            name=name,
            title=f"Universal Robots UR{title}{' (CB3)' * (name == 'ur5')} with an ATI Gamma",
            sensor="ati-gamma",
            links=tuple(links),
            flange=BodyMass("flange", 0.255, (0.0, 0.0, 0.0167)),
            home=(0.0, -1.2, -1.9, -1.6, 1.5708, 0.0),
            # a 1.35 kg cylinder of 40 mm radius and 140 mm length, a little off centre
            tool=Load(1.35, (0.004, -0.006, 0.071), (2.7e-3, 2.7e-3, 1.1e-3, 0.0, 0.0, 0.0)),
            limbs=tuple(((k, 0.0, z * side), (k, links[k].a, z * side)) for k, z in _LIMBS),
            wrist=(4, 5),
            tool_axis=(0.0, 0.07, 0.14, 0.2),
            table=_TABLE * scale,
            column=_COLUMN * scale,
            clearance=_CLEARANCE * max(scale, 1.0),
        )
    )


ROBOT = ur_arm("ur5")
