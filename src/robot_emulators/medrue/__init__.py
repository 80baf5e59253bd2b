"""MedRUE behind a CAN bus: six CiA 402 drives and an ATI Mini40 on its NETCANOEM board.
Imports: emulators/base, emulators/can_bus, robots, sensors, errors.
Read first: server.py, then drive.py.
"""

from robot_emulators.medrue.server import MedrueEmulator

EMULATOR = MedrueEmulator

__all__ = ["EMULATOR", "MedrueEmulator"]
