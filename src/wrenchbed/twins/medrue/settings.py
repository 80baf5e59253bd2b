"""What this twin alone can be told, read from words."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import tau

import numpy as np

from wrenchbed.errors import ParameterError
from wrenchbed.robots.base import Robot

KNOWN = {
    "port": "TCP port of the bus (29536)",
    "channel": "name of the bus (can0)",
    "bitrate": "of the wire model [bit/s] (1000000)",
    "wire": "on: frames take the time that their bits take (off)",
    "bus": "virtual:NAME or socketcan:vcanN, a bus of python-can to serve as well (none)",
    "nodes": "ids of the six drives (1,2,3,4,5,6)",
    "base": "upper seven bits of the sensor board's ids (0x68)",
    "slot": "where the board keeps the sensor's calibration, 0 … 15 (0)",
    "counts": "of the sensor board per N and per N·m (1000000)",
    "counts_per_metre": "of the linear axis (1000000)",
    "counts_per_turn": "of the rotary axes (1048576)",
    "rated_force": "of the linear axis's motor [N] (200)",
    "rated_torque": "of the rotary axes' motors [N·m] (2)",
    "watchdog": "silence of a drive's RPDO that stops it [s], until it is told another (0.1)",
}
_JOINTS = 6


@dataclass(frozen=True)
class Settings:
    """See `KNOWN`."""

    port: int = 29536
    channel: str = "can0"
    bitrate: int = 1_000_000
    wire: bool = False
    bus: str = ""
    nodes: tuple[int, ...] = (1, 2, 3, 4, 5, 6)
    base: int = 0x68
    slot: int = 0
    counts: int = 1_000_000
    counts_per_metre: float = 1e6
    counts_per_turn: float = float(1 << 20)
    rated_force: float = 200.0
    rated_torque: float = 2.0
    watchdog: float = 0.1

    def per_unit(self, robot: Robot) -> np.ndarray:
        """Counts per rad or m of each joint (J,)."""
        turn = self.counts_per_turn / tau
        return np.array([self.counts_per_metre if j.unit == "m" else turn for j in robot.joints])


def read(words: Mapping[str, str]) -> Settings:
    """Settings from words by name.

    Raises:
        ParameterError: an unknown name, listing all, or a value that is none.
    """
    unknown = sorted(set(words) - set(KNOWN))
    if unknown:
        known = "; ".join(f"{name}: {what}" for name, what in KNOWN.items())
        raise ParameterError(f"--set {unknown[0]}: there is no such setting. Known: {known}")
    values: dict[str, object] = {}
    for name, word in words.items():
        try:
            values[name] = _value(name, word)
        except ValueError as error:
            raise ParameterError(f"--set {name}={word}: {error}; {KNOWN[name]}") from error
    return Settings(**values)  # type: ignore[arg-type]


def _value(name: str, word: str) -> object:
    match name:
        case "channel":
            return word
        case "bus":
            kind, _, channel = word.partition(":")
            if kind not in ("virtual", "socketcan") or not channel:
                raise ValueError("give virtual:NAME or socketcan:vcanN")
            if kind == "socketcan" and not channel.startswith("vcan"):
                raise ValueError("a twin serves virtual buses alone, never one with real devices")
            return word
        case "wire":
            if word not in ("on", "off"):
                raise ValueError("on or off")
            return word == "on"
        case "nodes":
            nodes = tuple(int(part, 0) for part in word.split(","))
            if len(set(nodes)) != _JOINTS or not all(1 <= node <= 127 for node in nodes):
                raise ValueError("six different numbers from 1 to 127")
            return nodes
        case "counts_per_metre" | "counts_per_turn" | "rated_force" | "rated_torque" | "watchdog":
            return _above(float(word), 0.0)
        case _:
            top = {"port": 65535, "base": 0x7F, "slot": 15}.get(name, 1 << 31)
            number = int(word, 0)
            if not (0 if name != "bitrate" else 1000) <= number <= top:
                raise ValueError(f"a whole number up to {top}")
            return number


def _above(value: float, least: float) -> float:
    if not value > least:
        raise ValueError(f"above {least:g}")
    return value
