"""The MedRUE emulator: hub, drives, sensor board and plant, with its settings and faults."""

import random
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import tau
from typing import ClassVar

import numpy as np

from robot_emulators.base import arguments
from robot_emulators.base.arguments import (
    Argument,
    Settings,
    above,
    described,
    flag,
    integer,
    read,
    setting,
    text,
)
from robot_emulators.base.emulator import Emulator, Options
from robot_emulators.base.faults import Faults, Handler, TimedFault
from robot_emulators.can_bus.hub import Bridge, Hub
from robot_emulators.can_bus.wire import Frame
from robot_emulators.medrue.axis import FOLLOWING_ERROR
from robot_emulators.medrue.board import RESET, SELECT, SET_BASE, SET_BITRATE, BoardEmulator
from robot_emulators.medrue.drive import DriveEmulator
from robot_emulators.medrue.plant import CYCLE_S, RealTimePlant
from robot_emulators.medrue.profile import Ratings
from robot_emulators.plant import Arm, PlantMaker, PlantRequest

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

    def per_unit(self, arm: Arm) -> np.ndarray:
        """Counts per rad or m of each joint (J,)."""
        return np.where(arm.linear, self.counts_per_metre, self.counts_per_turn / tau)


_FOREVER = 1e9
_SETTING = (SELECT, RESET, SET_BASE, SET_BITRATE)
_GARBAGE_TEXT = b"< frame zz >\xff\xfe< nonsense > frame 12"
Pair = list[tuple[int, bytes]]


class BusFaults:
    """Handlers of the faults. ``node`` names a drive, the first one where it is not given."""

    def __init__(
        self, faults: Faults, hub: Hub, drives: Sequence[DriveEmulator], board: BoardEmulator
    ) -> None:
        self._hub, self._board = hub, board
        self._drives = {drive.node: drive for drive in drives}
        self._chance = random.Random(0)
        self._impostor_until = 0.0
        self._impostor = hub.attach(self._pose, frozenset((board.base << 4,)))
        node = {"node": _one_of(list(self._drives))}
        count, share = arguments.integer(1, 1000, 1), arguments.number(0.01, 1.0, 1.0)
        drive, order = self._drive, hub.order
        kinds: dict[str, tuple[Handler, Mapping[str, Argument]]] = {
            "mute": (self._mute, node),
            "frozen": (lambda f: setattr(drive(f), "frozen_until", _until(f)), node),
            "heartbeat_loss": (
                lambda f: setattr(drive(f), "heartbeat_off_until", _until(f)), node,
            ),
            "following_error": (lambda f: drive(f).axis.fault(FOLLOWING_ERROR), node),
            "emcy": (
                lambda f: drive(f).axis.fault(int(f.values["code"])),
                node | {"code": arguments.integer(1, 0xFFFF, 0x5441)},
            ),
            "node_reboot": (lambda f: order(drive(f).boot), node),
            "second_frame_lost": (self._second_lost, {"share": share}),
            "swapped_pair": (lambda f: self._spoil(f, lambda pair: pair[::-1]), {}),
            "saturated_gauge": (
                lambda f: board.railed.update({int(f.values["gauge"]): _until(f)}),
                {"gauge": arguments.integer(0, 5, 0)},
            ),
            "status": (self._status, {"bits": arguments.integer(1, 0xFFFF, 1 << 4)}),
            "reset_board": (self._reset_board, {"silent": arguments.flag(True)}),
            "mute_board": (lambda f: setattr(board, "silent_until", _until(f)), {}),
            "id_clash": (lambda f: setattr(self, "_impostor_until", _until(f)), {}),
            "error_frame": (
                lambda f: order(lambda: hub.destroy(int(f.values["count"]))), {"count": count},
            ),
            "overload": (self._overload, {"share": share}),
            "bus_off": (lambda f: order(lambda: hub.bus_off(_until(f))), {}),
            "hub_fin": (lambda f: order(hub.hang_up), {}),
            "stall": (
                lambda f: setattr(hub, "stalled_until", time.monotonic() + (f.seconds or 1.0)), {},
            ),
            "garbage_text": (lambda f: order(lambda: hub.say(_GARBAGE_TEXT)), {}),
            "garbage": (self._garbage, {"count": arguments.integer(1, 1000, 100)}),
        }  # fmt: skip
        for kind, (handler, more) in kinds.items():
            faults.on("can", kind, handler, more)

    def _drive(self, fault: TimedFault) -> DriveEmulator:
        return self._drives[int(fault.values["node"])]

    def _mute(self, fault: TimedFault) -> None:
        drive = self._drive(fault)
        drive.mute = True
        if fault.seconds:
            self._later(fault.seconds, lambda: setattr(drive, "mute", False))

    def _second_lost(self, fault: TimedFault) -> None:
        share = fault.values["share"]
        self._spoil(fault, lambda pair: pair[:1] if self._chance.random() < share else pair)

    def _spoil(self, fault: TimedFault, how: Callable[[Pair], Pair]) -> None:
        until = _until(fault)
        self._board.spoil = lambda pair: how(pair) if time.monotonic() < until else pair

    def _status(self, fault: TimedFault) -> None:
        board, bits = self._board, int(fault.values["bits"])
        board.status |= bits
        if fault.seconds:
            self._later(fault.seconds, lambda: setattr(board, "status", board.status & ~bits))

    def _reset_board(self, fault: TimedFault) -> None:
        self._board.reset(time.monotonic())
        if not fault.values["silent"]:
            self._board.silent_until = 0.0

    def _pose(self, t: float, frame: Frame) -> None:
        """Answer the sensor's gauge requests too, as a node at the same ids does."""
        base = self._board.base << 4
        if t < self._impostor_until and frame.can_id == base and not frame.data:
            self._impostor(Frame(base, bytes([0x37, 2, 1, 0, 0, 0, 7, 7])))
            self._impostor(Frame(base | 1, bytes(6)))

    def _overload(self, fault: TimedFault) -> None:
        hub, seconds, share = self._hub, fault.seconds or 1.0, fault.values["share"]
        hub.order(
            lambda: hub.foreign.start(time.monotonic(), seconds, share, hub.wire.load.bitrate)
        )

    def _garbage(self, fault: TimedFault) -> None:
        """Frames of any id but NMT, SYNC and those that would reconfigure something."""
        sensor = [self._board.base << 4 | k for k in range(16) if k not in _SETTING]
        ids = [*sensor, 0x181, 0x182, 0x081, 0x701, 0x581, 0x123, 0x7FF]
        for _ in range(int(fault.values["count"])):
            data = self._chance.randbytes(self._chance.randrange(9))
            self._impostor(Frame(self._chance.choice(ids), data))

    def _later(self, seconds: float, what: Callable[[], None]) -> None:
        self._hub.later(time.monotonic() + seconds, what)


def _until(fault: TimedFault) -> float:
    return time.monotonic() + (fault.seconds or _FOREVER)


def _one_of(nodes: Sequence[int]) -> Argument:
    """One of some whole numbers, the first where none is given."""
    known = ", ".join(str(node) for node in nodes)
    return Argument(
        lambda v: isinstance(v, int) and not isinstance(v, bool) and v in nodes,
        f"a node: {known}", nodes[0],
    )  # fmt: skip


WINDOW = {"m": 0.02, "rad": 0.1}
"""Largest following error; the simulated servos follow 24 ms behind, so at 80 % of top speed it
is reached only by a fault."""
_QUICK_S = 0.1
"""A quick stop from top speed takes so long [s]."""


class MedrueEmulator(Emulator):
    """Six CiA 402 drives and an ATI Mini40 with NETCANOEM on one CAN bus."""

    name = "medrue"
    title = "MedRUE: CiA 402 drives and ATI Mini40 on CAN (socketcand)"
    settings: ClassVar = described(BusSettings)

    def __init__(self, options: Options, make_plant: PlantMaker) -> None:
        super().__init__(options, make_plant)
        (setting,) = read(options.setting, BusSettings)
        self.setting: BusSettings = setting
        self.hub = Hub(
            options.host, setting.port, setting.channel, setting.bitrate, setting.wire, self.fail
        )
        body = make_plant(PlantRequest("medrue", CYCLE_S, drives=True))
        lock = threading.RLock()
        counts = setting.per_unit(body.arm)
        self.plant = RealTimePlant(body, counts, lock, self.fail)
        self.drives = [
            self._drive(setting.nodes[j], body.arm, j, counts[j], body.q[j], lock)
            for j in range(_JOINTS)
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
        self, node: int, arm: Arm, j: int, counts: float, q: float, lock: threading.RLock
    ) -> DriveEmulator:
        slides, top = arm.linear[j], arm.speed[j] * counts
        ratings = Ratings(
            lower=int(np.ceil(arm.lower[j] * counts)),
            upper=int(np.floor(arm.upper[j] * counts)),
            window=round(WINDOW["m" if slides else "rad"] * counts),
            quick=top / _QUICK_S,
            speed=top,
            acceleration=2.0 * top,
            torque=self.setting.rated_force if slides else self.setting.rated_torque,
        )
        heard: list[DriveEmulator] = []

        def hear(t: float, frame: Frame) -> None:
            heard[0].hear(t, frame)

        send = self.hub.attach(hear, frozenset())
        heard.append(
            DriveEmulator(
                node, send, ratings, q * counts, self.setting.watchdog, lock,
                lambda ids: self.hub.listen(hear, ids),
            )
        )  # fmt: skip
        return heard[0]

    def _board(self) -> BoardEmulator:
        heard: list[BoardEmulator] = []
        send = self.hub.attach(lambda t, frame: heard[0].hear(t, frame))
        setting = self.setting
        heard.append(
            BoardEmulator(
                send, setting.base, setting.slot, setting.counts, self.plant.wrench,
                self.plant.body.gauges, setting.bitrate,
            )
        )  # fmt: skip
        return heard[0]
