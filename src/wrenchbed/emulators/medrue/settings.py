"""Settings of the MedRUE emulator: its bus, drives and sensor board."""

from dataclasses import dataclass
from math import tau

import numpy as np

from wrenchbed.emulators.base.arguments import (
    Argument,
    Settings,
    above,
    flag,
    integer,
    setting,
    text,
)
from wrenchbed.robots.base import Robot

_JOINTS = 6


def _is_bus(name: str) -> bool:
    """``virtual:NAME`` or ``socketcan:vcanN``: never a bus with real devices. Or none."""
    kind, _, channel = name.partition(":")
    return not name or (kind == "virtual" and channel != "") or name.startswith("socketcan:vcan")


def _are_nodes(nodes: tuple[int, ...] | None) -> bool:
    six = nodes is not None and len(nodes) == len(set(nodes)) == _JOINTS
    return six and all(1 <= node <= 127 for node in nodes or ())


_BUS = Argument(_is_bus, "virtual:NAME or socketcan:vcanN; never a bus with real devices")
_NODES = Argument(
    _are_nodes, "six different numbers from 1 to 127",
    parse=lambda word: tuple(int(part, 0) for part in word.split(",")),
)  # fmt: skip


@dataclass(frozen=True)
class BusSettings(Settings):
    """What is on the bus, and how it counts."""

    port: int = setting(29536, integer(0, 65535), "TCP port of the bus (29536)")
    channel: str = setting("can0", text(), "name of the bus (can0)")
    bitrate: int = setting(1_000_000, integer(1000, 1 << 31), "of the wire model [bit/s] (1000000)")
    wire: bool = setting(False, flag(), "on: frames take the time that their bits take (off)")
    bus: str = setting(
        "", _BUS, "virtual:NAME or socketcan:vcanN, a bus of python-can to serve as well (none)"
    )
    nodes: tuple[int, ...] = setting(
        (1, 2, 3, 4, 5, 6), _NODES, "ids of the six drives (1,2,3,4,5,6)"
    )
    base: int = setting(0x68, integer(0, 0x7F), "upper seven bits of the sensor board's ids (0x68)")
    slot: int = setting(
        0, integer(0, 15), "where the board keeps the sensor's calibration, 0 … 15 (0)"
    )
    counts: int = setting(
        1_000_000, integer(0, 1 << 31), "of the sensor board per N and per N·m (1000000)"
    )
    counts_per_metre: float = setting(1e6, above(0.0), "of the linear axis (1000000)")
    counts_per_turn: float = setting(float(1 << 20), above(0.0), "of the rotary axes (1048576)")
    rated_force: float = setting(200.0, above(0.0), "of the linear axis's motor [N] (200)")
    rated_torque: float = setting(2.0, above(0.0), "of the rotary axes' motors [N·m] (2)")
    watchdog: float = setting(
        0.1, above(0.0),
        "silence of a drive's RPDO that stops it [s], until a client writes another (0.1)",
    )  # fmt: skip

    def per_unit(self, robot: Robot) -> np.ndarray:
        """Counts per rad or m of each joint (J,)."""
        turn = self.counts_per_turn / tau
        return np.array([self.counts_per_metre if j.unit == "m" else turn for j in robot.joints])
