"""MedRUE, a hybrid six-axis medical robot: Joubair et al. 2016, doi 10.3390/s16060798.
Imports physics and the robots' base.
Never: a number without the paper, or ``models/medrue/README.md``, as its source.
Read first: `robot`, then `kinematics`.
Used by: effects and studies; the registry, by the robot's name ``medrue``.
"""

from wrenchbed.robots.medrue.robot import MedRUE

ROBOT = MedRUE()
