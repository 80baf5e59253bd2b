"""Universal Robots' arms with an ATI Gamma: the UR5 (CB3), its inverse kinematics, and the others.

UR5: kinematics of the maker's Denavit–Hartenberg parameters (CB3 manual, table "UR5 serie 3");
masses and CoGs of "Parameters for calculations of kinematics and dynamics", there in the axes at a
link's end, here in those at its joint, as in ``models/ur5/ur5.xml``. Flange: the housing of an ATI
Gamma.

The others, two sources of the maker, equal where both were compared: the article "DH Parameters for
calculations of kinematics and dynamics" (universal-robots.com/articles/ur/application-installation;
CoGs in the axes at a link's end), and the ROS description (``config/ur*/`` of
Universal_Robots_ROS2_Description, and of ``ur_description`` in ros-industrial's universal_robot).
Every length, mass, CoG and top speed here is that of the ROS description; from the article alone:
mass and CoG of UR20's last link, 0.846 kg (the description has 0.926 kg). A UR7e is a UR5e and a
UR12e a UR10e with other payloads (the description has equal numbers). Top speeds of the UR8 Long
were not found: UR15's stand in, an estimate. Joints turn ±360°: in the maker's manuals; the ROS
description has ±180° at the elbow for its planners. Where poses are sampled is the UR5's, scaled:
an estimate.
"""

from dataclasses import replace
from functools import cache
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from wrenchbed.physics.gravity import BodyMass
from wrenchbed.physics.rotations import rot_x, rot_z
from wrenchbed.robots.serial_arm import ArmData, Link, SerialArm, mjcf_of

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
_SMALL = ((0.0, -0.02, 0.0), (0.13, 0.0, 0.1157), (0.05, 0.0, 0.0238), (0.0, 0.0, 0.01),
          (0.0, 0.0, 0.01), (0.0, 0.0, -0.02))  # fmt: skip
_MIDDLE = ((0.0, -0.02561, 0.00193), (0.2125, 0.0, 0.11336), (0.15, 0.0, 0.0265),
           (0.0, -0.0018, 0.01634), (0.0, 0.0018, 0.01634), (0.0, 0.0, -0.001159))  # fmt: skip
_LARGE = ((0.021, 0.0, 0.027), (0.38, 0.0, 0.158), (0.24, 0.0, 0.068), (0.0, 0.007, 0.018),
          (0.0, 0.007, 0.018), (0.0, 0.0, -0.026))  # fmt: skip
_SLOW_BASE = (120.0, 120.0, 180.0, 180.0, 180.0, 180.0)
_FAST_WRIST = (180.0, 180.0, 180.0, 360.0, 360.0, 360.0)


class _Published(NamedTuple):
    """Numbers that the maker publishes of an arm: d1, a2, a3, d4, d5, d6 [m]; masses of the links
    [kg]; CoGs [m] from the links' ends; top speeds of the joints [°/s]."""

    lengths: tuple[float, ...]
    masses: tuple[float, ...]
    cogs: tuple[tuple[float, float, float], ...]
    speeds: tuple[float, ...]


_UR5E = _Published(
    (0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996),
    (3.761, 8.058, 2.846, 1.37, 1.3, 0.365),
    _MIDDLE,
    (180.0,) * 6,
)
_UR10E = _Published(
    (0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655),
    (7.369, 13.051, 3.989, 2.1, 1.98, 0.615),
    _LARGE,
    _SLOW_BASE,
)


def _middle_size(
    a2: float, a3: float, masses: tuple[float, float], cogs: tuple[tuple[float, float, float], ...]
) -> _Published:
    """UR8 Long, UR15, UR18: one base and wrist; lengths, masses, CoGs of upper arm and forearm."""
    base, wrist = (0.000024, -0.033309, 0.025304), (0.000025, -0.019695, 0.016413)
    return _Published(
        (0.2186, a2, a3, 0.1824, 0.1361, 0.1434),
        (9.9883, *masses, 2.089, 2.0869, 1.0666),
        (base, *cogs, wrist, (0.000025, 0.01996, 0.015886), (-0.000018, -0.000112, -0.053397)),
        (180.0, 180.0, 240.0, 300.0, 300.0, 300.0),
    )


_ARMS = {
    "ur3": _Published(
        (0.1519, -0.24365, -0.21325, 0.11235, 0.08535, 0.0819),
        (2.0, 3.42, 1.26, 0.8, 0.8, 0.35), _SMALL, _FAST_WRIST,
    ),
    "ur10": _Published(
        (0.1273, -0.612, -0.5723, 0.163941, 0.1157, 0.0922),
        (7.1, 12.7, 4.27, 2.0, 2.0, 0.365), _LARGE, _SLOW_BASE,
    ),
    "ur3e": _Published(
        (0.15185, -0.24355, -0.2132, 0.13105, 0.08535, 0.0921),
        (1.98, 3.4445, 1.437, 0.871, 0.805, 0.261), _SMALL, _FAST_WRIST,
    ),
    "ur5e": _UR5E,
    "ur7e": _UR5E,
    "ur10e": _UR10E,
    "ur12e": _UR10E,
    "ur16e": _Published(
        (0.1807, -0.4784, -0.36, 0.17415, 0.11985, 0.11655),
        (7.369, 10.45, 4.321, 2.18, 2.033, 0.907),
        ((0.0, -0.016, 0.030), (0.302, 0.0, 0.160), (0.194, 0.0, 0.065), (0.0, -0.009, 0.011),
         (0.0, 0.018, 0.012), (0.0, 0.0, -0.044)),
        _SLOW_BASE,
    ),
    "ur20": _Published(
        (0.2363, -0.862, -0.7287, 0.201, 0.1593, 0.1543),
        (16.343, 29.632, 7.879, 3.054, 3.126, 0.846),
        ((0.0, -0.061, 0.0062), (0.5226, 0.0, 0.2098), (0.3234, 0.0, 0.0604),
         (0.0, -0.0026, 0.0393), (0.0, 0.0024, 0.0379), (0.0, -0.0003, -0.0318)),
        (120.0, 120.0, 150.0, 210.0, 210.0, 210.0),
    ),
    "ur30": _Published(
        (0.2363, -0.637, -0.5037, 0.201, 0.1593, 0.1543),
        (16.343, 28.542, 7.156, 3.054, 3.126, 0.926),
        ((-0.0001, -0.06, 0.0069), (0.3894, 0.0, 0.2103), (0.2257, 0.0, 0.0629),
         (0.0, -0.0048, 0.0353), (0.0, 0.0046, 0.0341), (0.0, 0.0, -0.0293)),
        (120.0, 120.0, 150.0, 210.0, 210.0, 210.0),
    ),
    "ur8long": _middle_size(
        -0.8989, -0.7149, (17.0738, 7.6393),
        ((0.565429, -0.000074, 0.19542), (0.416102, 0.000058, 0.065663)),
    ),
    "ur15": _middle_size(
        -0.6475, -0.5164, (14.9255, 6.1015),
        ((0.419009, -0.000083, 0.192787), (0.305471, 0.000019, 0.070552)),
    ),
    "ur18": _middle_size(
        -0.475, -0.3389, (14.2009, 5.52),
        ((0.308664, -0.000088, 0.190204), (0.199652, 0.000021, 0.073101)),
    ),
}  # fmt: skip
NAMES = tuple(_ARMS)
"""Arms beside the UR5, whose data and model are its own."""


class URArm(SerialArm):
    """An arm of Universal Robots with an ATI Gamma."""

    joint_names = JOINTS

    def drawn(self) -> "mujoco.MjSpec":
        """MJCF of the arm from its own file, or without shapes from its data."""
        import mujoco

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
            _transform(q, self.arm.links[i]) for q, i in zip(known, (0, 4, 5), strict=True)
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


def _transform(q: float, link: Link) -> np.ndarray:
    """Homogeneous transform (4, 4) of a link."""
    result = np.eye(4)
    result[:3, :3] = rot_z(q) @ rot_x(link.alpha)
    result[:3, 3] = rot_z(q) @ np.array([link.a, 0.0, link.d])
    return result


ROBOT = URArm(ARM)


@cache
def ur_arm(name: str) -> URArm:
    """An arm of `NAMES`, with the UR5's sensor and tool."""
    published, scale = _ARMS[name], _ARMS[name].lengths[1] / ARM.links[1].a
    links = tuple(
        _published_link(published, k, body)
        for k, body in enumerate(link.body.body for link in ARM.links)
    )
    side = published.lengths[3] / ARM.links[3].d
    limbs = tuple(((k, 0.0, z * side), (k, links[k].a, z * side)) for (k, _, z), _ in ARM.limbs)
    return URArm(
        replace(
            ARM,
            name=name,
            title=f"Universal Robots {_title(name)} with an ATI Gamma",
            links=links,
            limbs=limbs,
            table=ARM.table * scale,
            column=ARM.column * scale,
            clearance=ARM.clearance * max(scale, 1.0),
        )
    )


def _title(name: str) -> str:
    """Title of an arm: ``ur10e`` is the UR10e, ``ur8long`` the UR8 Long."""
    return "UR" + name[2:].replace("long", " Long")


def _published_link(published: _Published, k: int, body: str) -> Link:
    d1, a2, a3, d4, d5, d6 = published.lengths
    a, d = ((0.0, d1), (a2, 0.0), (a3, 0.0), (0.0, d4), (0.0, d5), (0.0, d6))[k]
    cog = rot_x(ALPHA[k]) @ np.array(published.cogs[k]) + np.array([a, 0.0, d])
    x, y, z = (float(round(c, 9)) for c in cog)
    mass = BodyMass(body, published.masses[k], (x, y, z))
    speed = float(np.deg2rad(published.speeds[k]))
    return Link(a, d, ALPHA[k], mass, -LIMIT, LIMIT, speed, SAMPLED[k], GEAR_RATIO)
