"""Universal Robots' arms with an ATI Gamma: the UR5 (CB3), its inverse kinematics, and the others.

UR5: kinematics of the maker's Denavit–Hartenberg parameters (CB3 manual, table "UR5 serie 3");
masses and CoGs of "Parameters for calculations of kinematics and dynamics", there in the axes at a
link's end, here in those at its joint, as in ``models/ur5/ur5.xml``. Flange: the housing of an ATI
Gamma. The others are in ``models/universal_robots.toml``, with their sources.

Joints turn ±360°: in the maker's manuals; the ROS description has ±180° at the elbow for its
planners. Where poses are sampled is the UR5's, scaled: an estimate.
"""

import tomllib
from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np

from wrenchbed.physics.gravity import BodyMass
from wrenchbed.physics.rotations import rot_x
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
_SINGULAR = 1e-9
"""Sine of joint 5 below which joints 4 and 6 turn about one axis."""
_A = (0.0, -0.425, -0.39225, 0.0, 0.0, 0.0)
_D = (0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823)
_BODIES = (
    BodyMass("shoulder", 3.7, (0.0, -0.00193, 0.063549)),
    BodyMass("upper_arm", 8.393, (-0.2125, 0.0, 0.11336)),
    BodyMass("forearm", 2.33, (-0.24225, 0.0, 0.0265)),
    BodyMass("wrist_1", 1.219, (0.0, -0.01634, 0.10735)),
    BodyMass("wrist_2", 1.219, (0.0, 0.01634, 0.09285)),
    BodyMass("wrist_3", 0.1879, (0.0, 0.0, 0.081141)),
)
TOP_SPEED = np.pi
"""180°/s at every joint: the same specifications [rad/s]."""

ARM = ArmData(
    name="ur5",
    title="Universal Robots UR5 (CB3) with an ATI Gamma",
    sensor="ati-gamma",
    links=tuple(
        Link(a, d, alpha, body, -LIMIT, LIMIT, TOP_SPEED, sampled, GEAR_RATIO)
        for a, d, alpha, body, sampled in zip(_A, _D, ALPHA, _BODIES, SAMPLED, strict=True)
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
_PUBLISHED = tomllib.loads((models() / "universal_robots.toml").read_text(encoding="utf-8"))
NAMES = tuple(_PUBLISHED)
"""Arms beside the UR5, whose data and model are its own."""


class URArm(SerialArm):
    """An arm of Universal Robots with an ATI Gamma."""

    joint_names = JOINTS

    def inverse(self, rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
        """Joint values (K, 6), K ≤ 8, in (−π, π], that bring the nominal flange to a pose.

        Args:
            rotation: R_world_flange (3, 3).
            position: of the flange in the world (3,) [m].
        """
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


ROBOT = URArm(ARM)


@cache
def ur_arm(name: str) -> URArm:
    """An arm of `NAMES`, with the UR5's sensor and tool."""
    published = _PUBLISHED[name]
    d1, a2, a3, d4, d5, d6 = published["lengths"]
    table = ((0.0, d1), (a2, 0.0), (a3, 0.0), (0.0, d4), (0.0, d5), (0.0, d6))
    figures = (published[name] for name in ("masses", "cogs", "speeds"))
    links = []
    for usual, (a, d), mass, at_end, speed in zip(ARM.links, table, *figures, strict=True):
        cog = rot_x(usual.alpha) @ np.array(at_end) + np.array([a, 0.0, d])
        x, y, z = (float(round(c, 9)) for c in cog)
        body = BodyMass(usual.body.body, mass, (x, y, z))
        links.append(replace(usual, a=a, d=d, body=body, speed=float(np.deg2rad(speed))))
    scale, side = a2 / ARM.links[1].a, d4 / ARM.links[3].d
    title = name.removeprefix("ur").replace("long", " Long")  # ``ur8long`` is the UR8 Long
    return URArm(
        replace(
            ARM,
            name=name,
            title=f"Universal Robots UR{title} with an ATI Gamma",
            links=tuple(links),
            limbs=tuple(
                ((k, 0.0, z * side), (k, links[k].a, z * side)) for (k, _, z), _ in ARM.limbs
            ),
            table=ARM.table * scale,
            column=ARM.column * scale,
            clearance=ARM.clearance * max(scale, 1.0),
        )
    )
