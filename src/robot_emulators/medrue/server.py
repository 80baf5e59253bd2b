"""The MedRUE emulator: bus, drives and sensor board in real time, the robot behind them, faults."""

import random
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from math import tau
from typing import ClassVar

import numpy as np

from robot_emulators.base import named_values as rules
from robot_emulators.base.emulator import Emulator, Options
from robot_emulators.base.faults import Faults, Handler, TimedFault
from robot_emulators.base.named_values import Argument, Settings, described, read, setting
from robot_emulators.base.real_time import CycleThread
from robot_emulators.can_bus import Frame, Hub
from robot_emulators.canopen.dictionary import Key
from robot_emulators.medrue.cia402_axis import FOLLOWING_ERROR
from robot_emulators.medrue.cia402_node import DriveEmulator, rated
from robot_emulators.medrue.gauge_board import RESET, SELECT, SET_BASE, SET_BITRATE, BoardEmulator
from robot_emulators.plant import Arm, Plant, PlantMaker, PlantRequest

_SETTING = (SELECT, RESET, SET_BASE, SET_BITRATE)
_GARBAGE_TEXT = b"< frame zz >\xff\xfe< nonsense > frame 12"
CYCLE_S = 0.004
_READINGS = 2
"""Sensor readings in a control cycle, so that the board can be asked at up to 500 Hz."""
_LATE_S = 0.1
"""Lag of the control cycle beyond which missed cycles are left out [s]; drives wait that long."""
_JOINTS = 6
_WINDOW_M, _WINDOW_RAD = 0.02, 0.1
"""Largest following errors [m], [rad]: the simulated servos lag by 24 ms, so that up to 80 % of top
speed only a fault reaches them."""
_RATED_N, _RATED_NM = 200.0, 2.0
_COUNTS_PER_M, _COUNTS_PER_TURN = 1e6, float(1 << 20)
"""Rated force [N], torque [N·m] of motors, counts of encoders: assumed, as none are published."""
_QUICK_S = 0.1
"""Duration of a quick stop from top speed [s], in which the linear axis slides 3 cm."""


class BusFaults:
    """Registers and carries out timed faults of the CAN bus, its drives and its sensor board."""

    def __init__(
        self, faults: Faults, hub: Hub, drives: Sequence[DriveEmulator], board: BoardEmulator
    ) -> None:
        self._faults, self._hub, self._board = faults, hub, board
        self._drives = {drive.node: drive for drive in drives}
        self._random = random.Random(0)
        self._impostor = hub.attach(self._answer_as_sensor)
        hub.loses = self._loses
        drive, order = self._drive, hub.order
        nodes = list(self._drives)
        node = {"node": Argument(nodes.__contains__, f"one of {nodes}", nodes[0])}
        count = {"count": rules.integer(1, 1000, 100)}
        kinds: dict[str, tuple[Handler | None, Mapping[str, Argument]]] = {
            "mute": (None, node), "frozen": (None, node), "heartbeat_loss": (None, node),
            "second_frame_lost": (None, {"share": rules.number(0.01, 1.0, 1.0)}),
            "swapped_pair": (None, {}), "mute_board": (None, {}), "id_clash": (None, {}),
            "saturated_gauge": (None, {"gauge": rules.integer(0, 5, 0)}),
            "status": (None, {"bits": rules.integer(1, 0xFFFF, 1 << 4)}),
            "stall": (None, {"id": rules.integer(-1, 0x7FF, -1)}),
            "following_error": (lambda f: drive(f).axis.fault(FOLLOWING_ERROR), node),
            "emcy": (
                lambda f: drive(f).axis.fault(int(f.values["code"])),
                node | {"code": rules.integer(1, 0xFFFF, 0x5441)},
            ),
            "node_reboot": (lambda f: order(drive(f).boot), node),
            "reset_board": (self._reset_board, {"silent": rules.flag(True)}),
            "bus_off": (lambda f: order(partial(hub.bus_off, f.end)), {}),
            "hub_fin": (lambda f: order(hub.hang_up), {}),
            "garbage_text": (lambda f: order(lambda: hub.say(_GARBAGE_TEXT)), {}),
            "garbage": (self._garbage, count),
        }  # fmt: skip
        for kind, (handler, more) in kinds.items():
            faults.on("can", kind, handler, more)

    def names(self, node: int, kind: str) -> bool:
        """Whether a fault of this kind is active for the drive with this node id."""
        values = self._faults.now("can", kind)
        return values is not None and values["node"] == node

    def _loses(self, frame: Frame) -> bool:
        stall = self._faults.now("can", "stall")
        return stall is not None and stall["id"] in (-1, frame.can_id)

    def _drive(self, fault: TimedFault) -> DriveEmulator:
        return self._drives[int(fault.values["node"])]

    def _reset_board(self, fault: TimedFault) -> None:
        self._board.reset(time.monotonic())
        if not fault.values["silent"]:
            self._board.silent_until = 0.0

    def _answer_as_sensor(self, t: float, frame: Frame) -> None:
        """Answer gauge requests a second time, as another node with the sensor's ids would."""
        base = self._board.base << 4
        asked = frame.can_id == base and not frame.data
        if asked and self._faults.now("can", "id_clash") is not None:
            self._impostor(Frame(base, bytes([0x37, 2, 1, 0, 0, 0, 7, 7])))
            self._impostor(Frame(base | 1, bytes(6)))

    def _garbage(self, fault: TimedFault) -> None:
        """Send random CAN frames: none that begin a cycle or change a node's state or settings."""
        sensor = [self._board.base << 4 | k for k in range(16) if k not in _SETTING]
        ids = [*sensor, 0x181, 0x182, 0x081, 0x701, 0x581, 0x123, 0x7FF]
        for _ in range(int(fault.values["count"])):
            data = self._random.randbytes(self._random.randrange(9))
            self._impostor(Frame(self._random.choice(ids), data))


def _are_nodes(nodes: tuple[int, ...] | None) -> bool:
    six = nodes is not None and len(nodes) == len(set(nodes)) == _JOINTS
    return six and all(1 <= node <= 127 for node in nodes or ())


_NODES = Argument(
    _are_nodes, "six different numbers from 1 to 127",
    parse=lambda word: tuple(int(part, 0) for part in word.split(",")),
)  # fmt: skip


@dataclass(frozen=True)
class BusSettings(Settings):
    """Settings of the emulated CAN bus: TCP port, bus name, drive ids and sensor board."""

    port: int = setting(29536, rules.integer(0, 65535), "TCP port of the bus (29536)")
    channel: str = setting("can0", rules.text(), "name of the bus (can0)")
    nodes: tuple[int, ...] = setting(
        (1, 2, 3, 4, 5, 6), _NODES, "ids of the six drives (1,2,3,4,5,6)"
    )
    base: int = setting(
        0x68, rules.integer(0, 0x7F), "upper seven bits of the sensor board's ids (0x68)"
    )
    slot: int = setting(
        0, rules.integer(0, 15), "where the board keeps the sensor's calibration, 0 … 15 (0)"
    )
    counts: int = setting(
        1_000_000, rules.integer(0, 1 << 31), "of the sensor board per N and per N·m (1000000)"
    )


class RealTimePlant:
    """Steps a robot (``body``) at 250 Hz in real time to the positions that its drives command.
    ``counts`` (6,): encoder counts per m or rad; ``lock``: held while drives are read; ``failed``
    gets an error that ends the thread."""

    def __init__(
        self, body: Plant, counts: np.ndarray, lock: threading.RLock,
        failed: Callable[[Exception], None],
    ) -> None:  # fmt: skip
        self.body, self.counts = body, counts
        self.drives: Sequence[DriveEmulator] = ()
        self._lock = lock
        self._thread = CycleThread("medrue plant", CYCLE_S, _LATE_S, self._step, failed)
        self._readings: tuple[float, np.ndarray] = (0.0, np.zeros((_READINGS, 6)))

    def wrench(self, t: float) -> np.ndarray:
        """Sensor reading (6,) [N, N·m] at a `time.monotonic` time [s]."""
        begun, rows = self._readings
        k = int((t - begun) / CYCLE_S * len(rows))
        return np.asarray(rows[min(max(k, 0), len(rows) - 1)])

    def start(self) -> None:
        self._measure(time.monotonic())
        self._thread.start()

    def stop(self) -> None:
        """Stop stepping the robot; may be called twice."""
        self._thread.stop()

    def _step(self, due: float) -> None:
        t = time.monotonic()
        q, qd = self.body.q * self.counts, self.body.qd * self.counts
        torque, current, _ = self.body.efforts
        rows = np.stack([q, qd, torque, current], axis=1).tolist()
        with self._lock:  # the bus waits for it
            commands = [
                drive.track(t, CYCLE_S, position, speed, effort, due)
                for drive, (position, speed, *effort) in zip(self.drives, rows, strict=True)
            ]
        self.body.step(np.array(commands) / self.counts, due)
        for drive in self.drives:
            drive.tick(t)
        self._measure(due)

    def _measure(self, t: float) -> None:
        times = self.body.time + CYCLE_S * np.arange(_READINGS) / _READINGS
        self._readings = (t, self.body.readings(times)[0])


class MedrueEmulator(Emulator):
    """Emulator of the robot MedRUE: six CiA 402 drives and an ATI Mini40 sensor on one CAN bus."""

    name = "medrue"
    title = "MedRUE: CiA 402 drives and ATI Mini40 on CAN (socketcand)"
    settings: ClassVar = described(BusSettings)

    def __init__(self, options: Options, make_plant: PlantMaker) -> None:
        super().__init__(options, make_plant)
        (setting,) = read(options.setting, BusSettings)
        self.setting: BusSettings = setting
        hub = self.hub = Hub(options.host, setting.port, setting.channel, self.fail)
        body = make_plant(PlantRequest("medrue", CYCLE_S, drives=True))
        counts = np.where(body.arm.linear, _COUNTS_PER_M, _COUNTS_PER_TURN / tau)
        lock = threading.RLock()
        self.plant = RealTimePlant(body, counts, lock, self.fail)
        self.drives: list[DriveEmulator] = []
        for j, node in enumerate(setting.nodes):
            send = hub.attach(partial(lambda j, t, frame: self.drives[j].hear(t, frame), j))
            values, position = self._rated(body.arm, j, counts[j]), body.q[j] * counts[j]
            self.drives.append(DriveEmulator(node, send, values, position, lock))
        self.plant.drives = self.drives
        send = hub.attach(lambda t, frame: self.board.hear(t, frame))
        self.board = BoardEmulator(
            send, setting.base, setting.slot, setting.counts, self.plant.wrench,
            body.gauges, fault=partial(self.faults.now, "can"),
        )  # fmt: skip
        faults = BusFaults(self.faults, hub, self.drives, self.board)
        for drive in self.drives:
            drive.fails = partial(faults.names, drive.node)

    def serve(self) -> dict[str, str]:
        self.hub.start()
        for drive in self.drives:
            drive.boot()
        self.plant.start()
        return {"can": f"socketcand:{self.hub.host}:{self.hub.port}:{self.hub.channel}"}

    def stop(self) -> None:
        self.plant.stop()
        self.hub.stop()

    def _rated(self, arm: Arm, j: int, counts: float) -> dict[Key, int]:
        """Values after power-up, by (index, subindex), of the drive of axis j (from 0) of ``arm``;
        ``counts`` are its encoder counts per m or rad."""
        slides, top = arm.linear[j], arm.speed[j] * counts
        return rated(
            lower=int(np.ceil(arm.lower[j] * counts)),
            upper=int(np.floor(arm.upper[j] * counts)),
            window=round((_WINDOW_M if slides else _WINDOW_RAD) * counts),
            quick=top / _QUICK_S,
            speed=top,
            acceleration=2.0 * top,
            torque=_RATED_N if slides else _RATED_NM,
        )
