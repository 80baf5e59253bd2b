"""UR5's moving bodies: masses and centres of gravity as in ``models/ur5/ur5.xml``.

Links: Universal Robots, "Parameters for calculations of kinematics and dynamics", there in the
axes at a link's end, here in those at its joint (DH frame i − 1 turned by joint i). Flange: the
housing of an ATI Gamma.
"""

from wrenchbed.gravity import Link, masses

LINKS = (
    Link("shoulder", 3.7, (0.0, -0.00193, 0.063549)),
    Link("upper_arm", 8.393, (-0.2125, 0.0, 0.11336)),
    Link("forearm", 2.33, (-0.24225, 0.0, 0.0265)),
    Link("wrist_1", 1.219, (0.0, -0.01634, 0.10735)),
    Link("wrist_2", 1.219, (0.0, 0.01634, 0.09285)),
    Link("wrist_3", 0.1879, (0.0, 0.0, 0.081141)),
    Link("flange", 0.255, (0.0, 0.0, 0.0167)),
)
MASSES = masses(LINKS)

GEAR_RATIO = (101.0,) * 6
"""Of Universal Robots' strain wave gears, equal at every joint."""
