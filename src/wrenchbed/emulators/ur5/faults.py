"""Faults: what the robot and its links do wrong when they are told to."""

import struct
import time
from collections.abc import Callable
from typing import Protocol

import numpy as np

from wrenchbed.emulators.base import arguments
from wrenchbed.emulators.base.arguments import Argument
from wrenchbed.emulators.base.faults import Faults, TimedFault
from wrenchbed.emulators.ur5 import packets
from wrenchbed.emulators.ur5.controller import Controller
from wrenchbed.emulators.ur5.network import Port
from wrenchbed.emulators.ur5.outputs import Timestamp
from wrenchbed.emulators.ur5.rtde import Rtde

Deed = Callable[[TimedFault], None]

_BROKEN = {
    "short_header": struct.pack(">HB", 1, packets.DATA),
    "empty_data": packets.packet(packets.DATA),
    "short_data": packets.packet(packets.DATA, bytes([1]) + bytes(11)),
    "unknown_type": packets.packet(ord("?"), b"what is this"),
    "garbage": bytes(range(255, 0, -7)),
}
_MOST_OFF = 0.5
"""Largest following error [rad]."""
_ASKS: dict[tuple[str, str], dict[str, Argument]] = {
    ("rtde", "malformed"): {"how": arguments.word(_BROKEN)},
    ("rtde", "text"): {"message": arguments.text("this is a fault that was asked for")},
    ("rtde", "timestamp_jump"): {"by": arguments.number(-1e6, 1e6)},
    ("rtde", "timestamp_scale"): {"factor": arguments.number(0.0, 100.0)},
    ("robot", "follow_error"): {"joints": arguments.numbers(6, _MOST_OFF)},
}
"""What a kind of fault must or may be told."""


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


class Misbehaviour:
    """Every fault of the emulator; each runs in the loop's thread."""

    def __init__(self, twin: Target) -> None:
        self._twin = twin

    def register(self, faults: Faults) -> None:
        """Tell what each link knows."""
        outputs = self._twin.controller.fields
        fields = {
            "field": Argument(lambda v: isinstance(v, str) and v in outputs, "an output's name")
        }
        known = _ASKS | {("rtde", "not_found"): fields}
        for link, deeds in self._deeds().items():
            for kind, deed in deeds.items():
                faults.on(link, kind, self._in_loop(deed), known.get((link, kind)))

    def _in_loop(self, deed: Callable[[TimedFault], Callable[[], None]]) -> Deed:
        def handler(fault: TimedFault) -> None:
            self._twin.soon(deed(fault))

        return handler

    def _deeds(self) -> dict[str, dict[str, Callable[[TimedFault], Callable[[], None]]]]:
        twin = self._twin
        return {
            "rtde": self._port("rtde") | {
                "freeze": lambda f: lambda: twin.rtde.freeze(_end(f), twin.controller.values),
                "drop": lambda f: lambda: setattr(twin.rtde, "silent_until", _end(f)),
                "burst": lambda f: lambda: setattr(twin.rtde, "held_until", _end(f)),
                "refuse_start": lambda f: lambda: setattr(
                    twin.rtde.offer.denials, "start", _end(f)
                ),
                "in_use": lambda f: lambda: setattr(twin.rtde.offer.denials, "inputs", _end(f)),
                "not_found": self._not_found,
                "malformed": self._malformed,
                "text": self._text,
                "timestamp_jump": self._jump,
                "timestamp_scale": self._scale,
            },
            "dashboard": self._port("dashboard"),
            "script": self._port("script"),
            "control": {
                "fin": lambda f: lambda: twin.rtde.hang_up(writers_only=True),
                "rst": lambda f: lambda: twin.rtde.hang_up(reset=True, writers_only=True),
            },
            "robot": self._robot(),
        }  # fmt: skip

    def _port(self, name: str) -> dict[str, Callable[[TimedFault], Callable[[], None]]]:
        """What every port can do wrong."""
        port = self._twin.ports[name]
        return {
            "fin": lambda f: lambda: port.hang_up(),
            "rst": lambda f: lambda: port.hang_up(reset=True),
            "stall": lambda f: lambda: port.stall(_end(f)),
            "deaf": lambda f: lambda: setattr(port, "deaf_until", _end(f)),
            "unlisten": lambda f: lambda: port.unlisten(_end(f)),
        }

    def _robot(self) -> dict[str, Callable[[TimedFault], Callable[[], None]]]:
        twin, controller = self._twin, self._twin.controller
        return {
            "protective_stop": lambda f: controller.protective_stop,
            "emergency_stop": lambda f: lambda: controller.emergency_stop(_end(f)),
            "program_stop": lambda f: controller.stop_program,
            "power_off": lambda f: controller.power_off,
            "script_never_starts": lambda f: (
                lambda: setattr(controller, "script_denied_until", _end(f))
            ),
            "follow_error": self._follow_error,
            "restart": lambda f: lambda: twin.restart(f.seconds),
        }

    def _not_found(self, fault: TimedFault) -> Callable[[], None]:
        outputs = self._twin.rtde.offer.denials.outputs
        return lambda: outputs.update({fault.values["field"]: _end(fault)})

    def _malformed(self, fault: TimedFault) -> Callable[[], None]:
        return lambda: self._twin.rtde.inject(_BROKEN[fault.values["how"]])

    def _text(self, fault: TimedFault) -> Callable[[], None]:
        return lambda: self._twin.rtde.say(fault.values["message"], packets.WARNING)

    def _jump(self, fault: TimedFault) -> Callable[[], None]:
        return lambda: self._twin.timestamp.jump(float(fault.values["by"]))

    def _scale(self, fault: TimedFault) -> Callable[[], None]:
        return lambda: self._twin.timestamp.scale(float(fault.values["factor"]), _end(fault))

    def _follow_error(self, fault: TimedFault) -> Callable[[], None]:
        joints = np.array(fault.values["joints"], dtype=float)
        return lambda: self._twin.controller.arm.deviate(joints, _end(fault))


def _end(fault: TimedFault) -> float:
    """When it ends on `time.monotonic` [s]; without seconds never."""
    return time.monotonic() + fault.seconds if fault.seconds else float("inf")
