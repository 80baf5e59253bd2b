"""Servers that speak the protocols of robots and sensors, for clients that know no difference.

An emulator asks a `Plant` for the robot behind it: a simulation, a model, or the small kinematic
one that is built in. Read first: README.md, plant.py, base/emulator.py, a device's folder.
Free: the inside of each file (tests/emulators). Others rely on: the names here, members of `Plant`,
which whoever has a simulation implements (a new one needs a default). Never: import wrenchbed.
"""

from robot_emulators.base.emulator import Emulator, Options
from robot_emulators.base.faults import Faults, TimedFault
from robot_emulators.errors import EmulatorError, EmulatorWarning, FaultError, SettingError
from robot_emulators.plant import Arm, Efforts, Payload, Plant, PlantMaker, PlantRequest
from robot_emulators.serving import EMULATORS, Device, load, medrue, netft, serve, ur5

__all__ = [
    "EMULATORS",
    "Arm",
    "Device",
    "Efforts",
    "Emulator",
    "EmulatorError",
    "EmulatorWarning",
    "FaultError",
    "Faults",
    "Options",
    "Payload",
    "Plant",
    "PlantMaker",
    "PlantRequest",
    "SettingError",
    "TimedFault",
    "load",
    "medrue",
    "netft",
    "serve",
    "ur5",
]
