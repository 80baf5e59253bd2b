"""A UR5 with its CB3 (or e-Series) controller: unmodified RTDE clients connect to it."""

from wrenchbed.twins.ur5.server import UR5Twin

TWIN = UR5Twin
