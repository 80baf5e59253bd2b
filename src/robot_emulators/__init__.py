"""Servers that speak the network protocols of robots and sensors; client libraries run unchanged.

An emulator asks a `Plant` for the robot behind it: a simulation, a model, or the small kinematic
one that is built in. Read first: README.md, plant.py, base/emulator.py, a device's folder.
Free: the code of each file, as long as tests/emulators pass. Not free: names in `__all__` (change
README.md and wrenchbed/plant, their only importer, too); members of `Plant` (give a new one a
default; wrenchbed/plant implements it); names of emulators, ports, settings and faults (change
docs/how-to/hardware.md too); delays (run scripts/reactions). Never: import wrenchbed.
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
