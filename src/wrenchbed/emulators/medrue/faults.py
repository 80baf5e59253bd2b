"""Faults of the MedRUE emulator: link ``can``."""

import random
import time
from collections.abc import Callable, Mapping, Sequence

from wrenchbed.emulators.base import arguments
from wrenchbed.emulators.base.arguments import Argument
from wrenchbed.emulators.base.faults import Faults, Handler, TimedFault
from wrenchbed.emulators.can_bus.hub import Hub
from wrenchbed.emulators.can_bus.wire import Frame
from wrenchbed.emulators.medrue.axis import FOLLOWING_ERROR
from wrenchbed.emulators.medrue.board import RESET, SELECT, SET_BASE, SET_BITRATE, BoardEmulator
from wrenchbed.emulators.medrue.drive import DriveEmulator

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
