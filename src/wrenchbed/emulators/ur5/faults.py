"""Faults of the UR5 emulator: of the robot and of its links."""

import struct
import time
from collections.abc import Callable
from typing import Protocol

import numpy as np

from wrenchbed.emulators.base import arguments
from wrenchbed.emulators.base.arguments import Argument
from wrenchbed.emulators.base.faults import Faults, Handler, TimedFault
from wrenchbed.emulators.ur5 import packets
from wrenchbed.emulators.ur5.controller import Controller
from wrenchbed.emulators.ur5.network import Port
from wrenchbed.emulators.ur5.outputs import Timestamp
from wrenchbed.emulators.ur5.rtde import Rtde

_BROKEN = {
    "short_header": struct.pack(">HB", 1, packets.DATA),
    "empty_data": packets.packet(packets.DATA),
    "short_data": packets.packet(packets.DATA, bytes([1]) + bytes(11)),
    "unknown_type": packets.packet(ord("?"), b"what is this"),
    "garbage": bytes(range(255, 0, -7)),
}
_MOST_OFF = 0.5
"""Largest following error [rad]."""
_ARGUMENTS: dict[tuple[str, str], dict[str, Argument]] = {
    ("rtde", "malformed"): {"how": arguments.word(_BROKEN)},
    ("rtde", "text"): {"message": arguments.text("this is a fault that was asked for")},
    ("rtde", "timestamp_jump"): {"by": arguments.number(-1e6, 1e6)},
    ("rtde", "timestamp_scale"): {"factor": arguments.number(0.0, 100.0)},
    ("robot", "follow_error"): {"joints": arguments.numbers(6, _MOST_OFF)},
}
"""Arguments of a kind of fault, besides its time."""


class Target(Protocol):
    """What the faults act on."""

    controller: Controller
    rtde: Rtde
    ports: dict[str, Port]
    timestamp: Timestamp

    def soon(self, task: Callable[[], None]) -> None:
        """Run a task in the loop's thread."""
        ...

    def restart(self, seconds: float) -> None:
        """Cut the power of the control box for a time [s]."""
        ...


def register(emulator: Target, faults: Faults) -> None:
    """Register every fault of the emulator; each runs in the loop's thread."""
    outputs = emulator.controller.fields
    field = Argument(lambda v: isinstance(v, str) and v in outputs, "an output's name")
    known = _ARGUMENTS | {("rtde", "not_found"): {"field": field}}
    links = {
        "rtde": _port(emulator.ports["rtde"]) | _rtde(emulator),
        "dashboard": _port(emulator.ports["dashboard"]),
        "script": _port(emulator.ports["script"]),
        "control": {
            "fin": lambda f: emulator.rtde.hang_up(writers_only=True),
            "rst": lambda f: emulator.rtde.hang_up(reset=True, writers_only=True),
        },
        "robot": _robot(emulator),
    }
    for link, handlers in links.items():
        for kind, handler in handlers.items():
            faults.on(link, kind, _in_loop(emulator, handler), known.get((link, kind)))


def _in_loop(emulator: Target, handler: Handler) -> Handler:
    return lambda fault: emulator.soon(lambda: handler(fault))


def _port(port: Port) -> dict[str, Handler]:
    """Faults of every port."""
    return {
        "fin": lambda f: port.hang_up(),
        "rst": lambda f: port.hang_up(reset=True),
        "stall": lambda f: port.stall(_end(f)),
        "deaf": lambda f: setattr(port, "deaf_until", _end(f)),
        "unlisten": lambda f: port.unlisten(_end(f)),
    }


def _rtde(emulator: Target) -> dict[str, Handler]:
    rtde, denials = emulator.rtde, emulator.rtde.offer.denials
    controller, timestamp = emulator.controller, emulator.timestamp
    return {
        "freeze": lambda f: rtde.freeze(_end(f), controller.values),
        "drop": lambda f: setattr(rtde, "silent_until", _end(f)),
        "burst": lambda f: setattr(rtde, "held_until", _end(f)),
        "refuse_start": lambda f: setattr(denials, "start", _end(f)),
        "in_use": lambda f: setattr(denials, "inputs", _end(f)),
        "not_found": lambda f: denials.outputs.update({f.values["field"]: _end(f)}),
        "malformed": lambda f: rtde.inject(_BROKEN[f.values["how"]]),
        "text": lambda f: rtde.say(f.values["message"], packets.WARNING),
        "timestamp_jump": lambda f: timestamp.jump(float(f.values["by"])),
        "timestamp_scale": lambda f: timestamp.scale(float(f.values["factor"]), _end(f)),
    }


def _robot(emulator: Target) -> dict[str, Handler]:
    controller = emulator.controller
    return {
        "protective_stop": lambda f: controller.protective_stop(),
        "emergency_stop": lambda f: controller.emergency_stop(_end(f)),
        "program_stop": lambda f: controller.stop_program(),
        "power_off": lambda f: controller.power_off(),
        "script_never_starts": lambda f: setattr(controller, "script_denied_until", _end(f)),
        "follow_error": lambda f: controller.arm.deviate(np.array(f.values["joints"]), _end(f)),
        "restart": lambda f: emulator.restart(f.seconds),
    }


def _end(fault: TimedFault) -> float:
    """When it ends on `time.monotonic` [s]; without seconds never."""
    return time.monotonic() + fault.seconds if fault.seconds else float("inf")
