"""What can go wrong on this bus, on command: link ``can`` of the twin's faults."""

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
        count, share = (
            {"count": arguments.integer(1, 1000, 1)},
            {"share": arguments.number(0.01, 1.0, 1.0)},
        )
        kinds: dict[str, tuple[Handler, Mapping[str, Argument]]] = {
            "mute": (self._mute, node), "frozen": (self._frozen, node),
            "heartbeat_loss": (self._heartbeat, node), "following_error": (self._following, node),
            "emcy": (self._emcy, node | {"code": arguments.integer(1, 0xFFFF, 0x5441)}),
            "node_reboot": (self._reboot, node),
            "second_frame_lost": (self._second_lost, share), "swapped_pair": (self._swapped, {}),
            "saturated_gauge": (self._saturated, {"gauge": arguments.integer(0, 5, 0)}),
            "status": (self._status, {"bits": arguments.integer(1, 0xFFFF, 1 << 4)}),
            "reset_board": (self._reset_board, {"silent": arguments.flag(True)}),
            "mute_board": (self._mute_board, {}), "id_clash": (self._clash, {}),
            "error_frame": (self._error_frame, count), "overload": (self._overload, share),
            "bus_off": (self._bus_off, {}), "hub_fin": (self._hang_up, {}),
            "stall": (self._stall, {}), "garbage_text": (self._garbage_text, {}),
            "garbage": (self._garbage, {"count": arguments.integer(1, 1000, 100)}),
        }  # fmt: skip
        for kind, (handler, asked) in kinds.items():
            faults.on("can", kind, handler, asked)

    def _drive(self, fault: TimedFault) -> DriveEmulator:
        return self._drives[int(fault.values["node"])]

    def _mute(self, fault: TimedFault) -> None:
        drive = self._drive(fault)
        drive.mute = True
        if fault.seconds:
            self._later(fault.seconds, lambda: setattr(drive, "mute", False))

    def _frozen(self, fault: TimedFault) -> None:
        self._drive(fault).frozen_until = _until(fault)

    def _heartbeat(self, fault: TimedFault) -> None:
        self._drive(fault).heartbeat_off_until = _until(fault)

    def _following(self, fault: TimedFault) -> None:
        self._drive(fault).axis.fault(FOLLOWING_ERROR)

    def _emcy(self, fault: TimedFault) -> None:
        self._drive(fault).axis.fault(int(fault.values["code"]))

    def _reboot(self, fault: TimedFault) -> None:
        self._hub.order(self._drive(fault).boot)

    def _second_lost(self, fault: TimedFault) -> None:
        share = fault.values["share"]
        self._spoil(fault, lambda pair: pair[:1] if self._chance.random() < share else pair)

    def _swapped(self, fault: TimedFault) -> None:
        self._spoil(fault, lambda pair: pair[::-1])

    def _spoil(self, fault: TimedFault, how: Callable[[Pair], Pair]) -> None:
        until = _until(fault)
        self._board.spoil = lambda pair: how(pair) if time.monotonic() < until else pair

    def _saturated(self, fault: TimedFault) -> None:
        self._board.railed[int(fault.values["gauge"])] = _until(fault)

    def _status(self, fault: TimedFault) -> None:
        bits = int(fault.values["bits"])
        self._board.status |= bits
        if fault.seconds:
            self._later(fault.seconds, lambda: self._clear_status(bits))

    def _clear_status(self, bits: int) -> None:
        self._board.status &= ~bits

    def _reset_board(self, fault: TimedFault) -> None:
        self._board.reset(time.monotonic())
        if not fault.values["silent"]:
            self._board.silent_until = 0.0

    def _mute_board(self, fault: TimedFault) -> None:
        self._board.silent_until = _until(fault)

    def _clash(self, fault: TimedFault) -> None:
        self._impostor_until = _until(fault)

    def _pose(self, t: float, frame: Frame) -> None:
        """Answer the sensor's gauge requests too, as a node at the same ids does."""
        base = self._board.base << 4
        if t < self._impostor_until and frame.can_id == base and not frame.data:
            self._impostor(Frame(base, bytes([0x37, 2, 1, 0, 0, 0, 7, 7])))
            self._impostor(Frame(base | 1, bytes(6)))

    def _error_frame(self, fault: TimedFault) -> None:
        count = int(fault.values["count"])
        self._hub.order(lambda: self._hub.destroy(count))

    def _overload(self, fault: TimedFault) -> None:
        seconds, share = fault.seconds or 1.0, fault.values["share"]
        hub = self._hub
        hub.order(
            lambda: hub.foreign.start(time.monotonic(), seconds, share, hub.wire.load.bitrate)
        )

    def _hang_up(self, _: TimedFault) -> None:
        self._hub.order(self._hub.hang_up)

    def _bus_off(self, fault: TimedFault) -> None:
        """The adapters of all who have sent frames leave the bus."""
        until = _until(fault)
        self._hub.order(lambda: self._hub.bus_off(until))

    def _stall(self, fault: TimedFault) -> None:
        self._hub.stalled_until = time.monotonic() + (fault.seconds or 1.0)

    def _garbage(self, fault: TimedFault) -> None:
        """Frames of any id but NMT, SYNC and those that would reconfigure something."""
        sensor = [self._board.base << 4 | k for k in range(16) if k not in _SETTING]
        ids = [*sensor, 0x181, 0x182, 0x081, 0x701, 0x581, 0x123, 0x7FF]
        for _ in range(int(fault.values["count"])):
            data = self._chance.randbytes(self._chance.randrange(9))
            self._impostor(Frame(self._chance.choice(ids), data))

    def _garbage_text(self, _: TimedFault) -> None:
        self._hub.order(lambda: self._hub.say(_GARBAGE_TEXT))

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
