"""What this twin alone can be told, read from words.

The twin: hub, drives, sensor board and plant, started and stopped together.
"""

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from math import tau
from typing import ClassVar

import numpy as np

from wrenchbed.emulators.base.emulator import Emulator, EmulatorOptions
from wrenchbed.emulators.can_bus.bridge import Bridge
from wrenchbed.emulators.can_bus.hub import Hub
from wrenchbed.emulators.medrue.axis import Ratings
from wrenchbed.emulators.medrue.board import BoardEmulator
from wrenchbed.emulators.medrue.drive import DriveEmulator
from wrenchbed.emulators.medrue.faults import BusFaults
from wrenchbed.emulators.medrue.plant import CYCLE_S, DrivenArm, RealTimePlant
from wrenchbed.errors import ParameterError
from wrenchbed.robots.base import Joint, Robot

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
class BusSettings:
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


def read(words: Mapping[str, str]) -> BusSettings:
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
    return BusSettings(**values)  # type: ignore[arg-type]


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


WINDOW = {"m": 0.02, "rad": 0.1}
"""Largest following error; the simulated servos follow 24 ms behind, so at 80 % of top speed it
is reached only by a fault."""
_QUICK_S = 0.1
"""A quick stop from top speed takes so long [s]."""


class MedrueEmulator(Emulator):
    """Six CiA 402 drives and an ATI Mini40 with NETCANOEM on one CAN bus."""

    name = "medrue"
    title = "MedRUE: CiA 402 drives and ATI Mini40 on CAN (socketcand)"
    settings: ClassVar = KNOWN

    def __init__(self, options: EmulatorOptions) -> None:
        super().__init__(options)
        self.setting = setting = read(options.setting)
        self.hub = Hub(
            options.host, setting.port, setting.channel, setting.bitrate, setting.wire, self.fail
        )
        body = DrivenArm(options.body("medrue"), CYCLE_S)
        lock = threading.RLock()
        counts = setting.per_unit(body.robot)
        self.plant = RealTimePlant(body, counts, lock, self.fail)
        self.drives = [
            self._drive(setting.nodes[j], joint, counts[j], body.q[j], lock)
            for j, joint in enumerate(body.robot.joints)
        ]
        self.plant.drives = self.drives
        self.board = self._board()
        self._bridge: Bridge | None = None
        BusFaults(self.faults, self.hub, self.drives, self.board)

    def serve(self) -> dict[str, str]:
        self.hub.start()
        kind, _, channel = self.setting.bus.partition(":")
        if kind:
            self._bridge = Bridge(self.hub, kind, channel)
        for drive in self.drives:
            drive.boot()
        self.plant.start()
        return {"can": f"socketcand:{self.hub.host}:{self.hub.port}:{self.hub.channel}"}

    def stop(self) -> None:
        self.plant.stop()
        if self._bridge is not None:
            self._bridge.stop()
        self.hub.stop()

    def _drive(
        self, node: int, joint: Joint, counts: float, q: float, lock: threading.RLock
    ) -> DriveEmulator:
        ratings = Ratings(
            lower=int(np.ceil(joint.lower * counts)),
            upper=int(np.floor(joint.upper * counts)),
            window=round(WINDOW[joint.unit] * counts),
            quick=joint.speed * counts / _QUICK_S,
            speed=joint.speed * counts,
            acceleration=2.0 * joint.speed * counts,
            torque=self.setting.rated_force if joint.unit == "m" else self.setting.rated_torque,
        )
        heard: list[DriveEmulator] = []
        ids = frozenset((0x000, 0x080, 0x200 + node, 0x600 + node))
        send = self.hub.attach(lambda t, frame: heard[0].hear(t, frame), ids)
        heard.append(DriveEmulator(node, send, ratings, q * counts, self.setting.watchdog, lock))
        return heard[0]

    def _board(self) -> BoardEmulator:
        heard: list[BoardEmulator] = []
        send = self.hub.attach(lambda t, frame: heard[0].hear(t, frame))
        setting = self.setting
        heard.append(
            BoardEmulator(
                send, setting.base, setting.slot, setting.counts, self.plant.wrench,
                setting.bitrate,
            )
        )  # fmt: skip
        return heard[0]
