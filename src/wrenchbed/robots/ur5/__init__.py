"""Universal Robots UR5 (CB3) with a six-axis sensor between flange and tool."""

from wrenchbed.robots.ur5.robot import UR5

ROBOT = UR5()
