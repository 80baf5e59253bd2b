"""MedRUE behind a CAN bus: six CiA 402 drives and an ATI Mini40 on its NETCANOEM board.
Imports: base, can_bus, plant, errors.
Read first: server.py, then drive.py.
"""

from robot_emulators.medrue.server import MedrueEmulator

__all__ = ["MedrueEmulator"]
