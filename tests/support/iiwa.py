"""A robot with seven joints made of data alone: what a new serial arm has to say."""

from pathlib import Path

import numpy as np

from wrenchbed.physics.gravity_torques import BodyMass
from wrenchbed.robots.arm_numbers import Load
from wrenchbed.robots.serial_arm import ArmData, Link, SerialArm

# KUKA LBR iiwa 14 R820: lengths 360, 420, 400 and 126 mm, limits and speeds of KUKA's data sheet;
# masses of the links as in MuJoCo Menagerie's kuka_iiwa_14. Centres of gravity: estimates.
D = (0.36, 0.0, 0.42, 0.0, 0.4, 0.0, 0.126)
ALPHA = np.pi / 2 * np.array([-1, 1, 1, -1, -1, 1, 0])
LIMITS = np.deg2rad([170, 120, 170, 120, 170, 120, 175])
SPEEDS = np.deg2rad([85, 85, 100, 75, 130, 135, 135])
MASSES = (5.76, 6.35, 3.5, 3.5, 3.5, 1.8, 1.2)
COGS = ((0, -0.03, -0.08), (0, 0.06, 0.04), (0, 0.03, -0.08), (0, 0.07, 0.03), (0, 0.02, -0.14),
        (0, 0, 0), (0, 0, 0.06))  # fmt: skip
TABLE = zip(D, ALPHA, LIMITS, SPEEDS, MASSES, COGS, strict=True)

IIWA = SerialArm(
    ArmData(
        name="iiwa14",
        title="KUKA LBR iiwa 14 R820 with an ATI Gamma",
        sensor="ati-gamma",
        links=tuple(
            Link(0.0, d, alpha, BodyMass(f"link{k}", mass, cog), -limit, limit, speed)
            for k, (d, alpha, limit, speed, mass, cog) in enumerate(TABLE, start=1)
        ),
        flange=BodyMass("flange", 0.3, (0.0, 0.0, 0.02)),
        home=(0.0, 0.6, 0.0, -1.4, 0.0, 1.0, 0.0),
        tool=Load(1.35, (0.004, -0.006, 0.071), (2.7e-3, 2.7e-3, 1.1e-3, 0.0, 0.0, 0.0)),
        limbs=(((1, 0.0, 0.0), (3, 0.0, 0.0)), ((3, 0.0, 0.0), (5, 0.0, 0.0))),
        wrist=(6,),
        tool_axis=(0.0, 0.07, 0.14, 0.2),
        table=0.12,
        column=0.2,
        clearance=0.09,
        mjcf=Path(__file__).parents[1] / "data" / "iiwa14.xml",
    )
)
