"""Universal Robots UR5 (CB3) with an ATI Gamma: its data.

Kinematics: the manufacturer's Denavit–Hartenberg parameters (CB3 manual, table "UR5 serie 3").
Masses and CoGs: Universal Robots, "Parameters for calculations of kinematics and dynamics", there
in the axes at a link's end, here in those at its joint, as in ``models/ur5/ur5.xml``. Flange: the
housing of an ATI Gamma. Inverse kinematics: `ur_arm`; the other arms: `ur_family`.
"""

import numpy as np

from wrenchbed.physics.gravity import BodyMass
from wrenchbed.robots.serial_arm import ArmData, Link
from wrenchbed.robots.ur_arm import ALPHA, GEAR_RATIO, LIMIT, SAMPLED, URArm

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


class UR5(URArm):
    """Universal Robots UR5 (CB3) with an ATI Gamma."""


ROBOT = UR5(ARM)
