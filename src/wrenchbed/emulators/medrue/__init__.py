"""MedRUE behind a CAN bus: six CiA 402 drives and an ATI Mini40 on its NETCANOEM board."""

from wrenchbed.emulators.medrue.server import MedrueEmulator

EMULATOR = MedrueEmulator

__all__ = ["EMULATOR", "MedrueEmulator"]
