"""A UR5 with its CB3 or e-Series controller: unmodified RTDE clients connect to it.
Imports: emulators/base, emulators/netft_box, twin, effects, robots, physics, errors.
Read first: server.py, then controller.py.
"""

from robot_emulators.ur5.server import UR5Emulator

EMULATOR = UR5Emulator
