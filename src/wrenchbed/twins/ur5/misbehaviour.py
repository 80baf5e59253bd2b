"""Faults: what the robot and its links do wrong when they are told to."""

import struct
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from wrenchbed.errors import MapError
from wrenchbed.serving.faults import Fault, Faults
from wrenchbed.twins.ur5 import wire

if TYPE_CHECKING:
    from wrenchbed.twins.ur5.server import UR5Twin

Deed = Callable[[Fault], None]

_BROKEN = {
    "short_header": struct.pack(">HB", 1, wire.DATA),
    "empty_data": wire.packet(wire.DATA),
    "short_data": wire.packet(wire.DATA, bytes([1]) + bytes(11)),
    "unknown_type": wire.packet(ord("?"), b"what is this"),
    "garbage": bytes(range(255, 0, -7)),
}
_MOST_OFF = 0.5
"""Largest following error [rad]."""


class Misbehaviour:
    """Every fault of the twin; each is done in the loop's thread."""

    def __init__(self, twin: "UR5Twin") -> None:
        self._twin = twin

    def register(self, faults: Faults) -> None:
        """Tell what each link knows."""
        for link, deeds in self._deeds().items():
            for kind, deed in deeds.items():
                faults.on(link, kind, self._in_loop(deed))

    def _in_loop(self, deed: Callable[[Fault], Callable[[], None]]) -> Deed:
        def handler(fault: Fault) -> None:
            self._twin.soon(deed(fault))

        return handler

    def _deeds(self) -> dict[str, dict[str, Callable[[Fault], Callable[[], None]]]]:
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
            "control": {"fin": lambda f: lambda: twin.rtde.hang_up(writers_only=True)},
            "robot": self._robot(),
        }  # fmt: skip

    def _port(self, name: str) -> dict[str, Callable[[Fault], Callable[[], None]]]:
        """What every port can do wrong."""
        port = self._twin.ports[name]
        return {
            "fin": lambda f: lambda: port.hang_up(),
            "rst": lambda f: lambda: port.hang_up(reset=True),
            "stall": lambda f: lambda: setattr(port, "stalled_until", _end(f)),
            "deaf": lambda f: lambda: setattr(port, "deaf_until", _end(f)),
            "unlisten": lambda f: lambda: port.unlisten(_end(f)),
        }

    def _robot(self) -> dict[str, Callable[[Fault], Callable[[], None]]]:
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

    def _not_found(self, fault: Fault) -> Callable[[], None]:
        field, outputs = fault.values.get("field"), self._twin.rtde.offer.denials.outputs
        if field not in self._twin.controller.fields:
            raise MapError(f"fault rtde not_found: field = {field!r} must be an output's name")
        return lambda: outputs.update({str(field): _end(fault)})

    def _malformed(self, fault: Fault) -> Callable[[], None]:
        how = fault.values.get("how")
        if how not in _BROKEN:
            raise MapError(f"fault rtde malformed: how = {how!r} must be one of {list(_BROKEN)}")
        return lambda: self._twin.rtde.inject(_BROKEN[str(how)])

    def _text(self, fault: Fault) -> Callable[[], None]:
        message = str(fault.values.get("message", "this is a fault that was asked for"))
        return lambda: self._twin.rtde.say(message, wire.WARNING)

    def _jump(self, fault: Fault) -> Callable[[], None]:
        by = _number(fault, "by")
        return lambda: self._twin.timestamp.jump(by)

    def _scale(self, fault: Fault) -> Callable[[], None]:
        factor = _number(fault, "factor")
        return lambda: self._twin.timestamp.scale(factor, _end(fault))

    def _follow_error(self, fault: Fault) -> Callable[[], None]:
        raw: Any = fault.values.get("joints")
        try:
            joints = np.array(raw, dtype=float)
        except (TypeError, ValueError):
            joints = np.zeros(0)
        if joints.shape != (6,) or not (np.abs(joints) <= _MOST_OFF).all():
            raise MapError(
                f"fault robot follow_error: joints = {raw!r} must be six angles, "
                f"none beyond {_MOST_OFF:g} rad"
            )
        return lambda: self._twin.controller.arm.deviate(joints, _end(fault))


def _end(fault: Fault) -> float:
    """When it ends on `time.monotonic` [s]; without seconds never."""
    return time.monotonic() + fault.seconds if fault.seconds else float("inf")


def _number(fault: Fault, key: str) -> float:
    value = fault.values.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        raise MapError(f"fault {fault.link} {fault.kind}: {key} = {value!r} must be a number")
    return float(value)
