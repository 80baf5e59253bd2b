"""A UR5 with its CB3 (or e-Series) controller: unmodified RTDE clients connect to it."""

from wrenchbed.emulators.ur5.server import UR5Emulator

EMULATOR = UR5Emulator
