"""Servers that speak the network protocols of robots and sensors; client libraries run unchanged.

An emulator asks a `Plant` for the robot behind it: a simulation, a model, or the small kinematic
one that is built in. Read first: README.md, plant.py, base/emulator.py, a device's folder.
Free: inside of each file (tests/emulators). Others rely on: names here (wrenchbed/plant, README),
members of `Plant` (a new one needs a default), port numbers. Never: import wrenchbed.
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
