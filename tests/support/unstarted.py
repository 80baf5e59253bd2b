"""Emulators before robots in MuJoCo, not started."""

from robot_emulators import Emulator
from wrenchbed import registry
from wrenchbed.plant.serving import EmulatorOptions


def emulated(kind: str | type[Emulator], options: EmulatorOptions) -> Emulator:
    kind = registry.load("emulators", kind) if isinstance(kind, str) else kind
    return kind(options, options.plant)
