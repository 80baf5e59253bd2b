"""What can go wrong on this bus, on command: link ``can`` of the twin's faults."""

import random
import time
from collections.abc import Callable, Sequence

from wrenchbed.errors import MapError
from wrenchbed.serving.canbus.hub import Hub
from wrenchbed.serving.canbus.wire import Frame
from wrenchbed.serving.faults import Fault, Faults
from wrenchbed.twins.medrue.axis import FOLLOWING_ERROR
from wrenchbed.twins.medrue.board import Board
from wrenchbed.twins.medrue.drive import Drive

_FOREVER = 1e9
_GARBAGE_TEXT = b"< frame zz >\xff\xfe< nonsense > frame 12"
Pair = list[tuple[int, bytes]]


class Mischief:
    """Handlers of the faults. ``node`` names a drive, the first one where it is not given."""

    def __init__(self, faults: Faults, hub: Hub, drives: Sequence[Drive], board: Board) -> None:
        self._hub, self._board = hub, board
        self._drives = {drive.node: drive for drive in drives}
        self._chance = random.Random(0)
        self._impostor_until = 0.0
        self._impostor = hub.attach(self._pose, frozenset((board.base << 4,)))
        for kind, handler in {
            "mute": self._mute, "frozen": self._frozen, "heartbeat_loss": self._heartbeat,
            "following_error": self._following, "emcy": self._emcy, "node_reboot": self._reboot,
            "second_frame_lost": self._second_lost, "swapped_pair": self._swapped,
            "saturated_gauge": self._saturated, "status": self._status,
            "reset_board": self._reset_board, "mute_board": self._mute_board,
            "id_clash": self._clash, "error_frame": self._error_frame, "overload": self._overload,
            "bus_off": self._hang_up, "hub_fin": self._hang_up, "stall": self._stall,
            "garbage": self._garbage, "garbage_text": self._garbage_text,
        }.items():  # fmt: skip
            faults.on("can", kind, handler)

    def _drive(self, fault: Fault) -> Drive:
        node = fault.values.get("node", next(iter(self._drives)))
        if node not in self._drives:
            known = ", ".join(str(n) for n in self._drives)
            raise MapError(f"fault can {fault.kind}: there is no node {node!r}. Known: {known}")
        return self._drives[node]

    def _mute(self, fault: Fault) -> None:
        drive = self._drive(fault)
        drive.mute = True
        if fault.seconds:
            self._later(fault.seconds, lambda: setattr(drive, "mute", False))

    def _frozen(self, fault: Fault) -> None:
        self._drive(fault).frozen_until = _until(fault)

    def _heartbeat(self, fault: Fault) -> None:
        self._drive(fault).heartbeat_off_until = _until(fault)

    def _following(self, fault: Fault) -> None:
        self._drive(fault).axis.fault(FOLLOWING_ERROR)

    def _emcy(self, fault: Fault) -> None:
        self._drive(fault).axis.fault(_number(fault, "code", 0x5441))

    def _reboot(self, fault: Fault) -> None:
        self._hub.order(self._drive(fault).boot)

    def _second_lost(self, fault: Fault) -> None:
        share = float(fault.values.get("share", 1.0))
        self._spoil(fault, lambda pair: pair[:1] if self._chance.random() < share else pair)

    def _swapped(self, fault: Fault) -> None:
        self._spoil(fault, lambda pair: pair[::-1])

    def _spoil(self, fault: Fault, how: Callable[[Pair], Pair]) -> None:
        until = _until(fault)
        self._board.spoil = lambda pair: how(pair) if time.monotonic() < until else pair

    def _saturated(self, fault: Fault) -> None:
        gauge = _number(fault, "gauge", 0)
        if not 0 <= gauge < 6:
            raise MapError(f"fault can saturated_gauge: gauge {gauge} must be 0 … 5")
        self._board.railed[gauge] = _until(fault)

    def _status(self, fault: Fault) -> None:
        bits = _number(fault, "bits", 1 << 4)
        self._board.status |= bits
        if fault.seconds:
            self._later(fault.seconds, lambda: self._clear_status(bits))

    def _clear_status(self, bits: int) -> None:
        self._board.status &= ~bits

    def _reset_board(self, fault: Fault) -> None:
        self._board.reset(time.monotonic())
        if fault.values.get("silent") is False:
            self._board.silent_until = 0.0

    def _mute_board(self, fault: Fault) -> None:
        self._board.silent_until = _until(fault)

    def _clash(self, fault: Fault) -> None:
        self._impostor_until = _until(fault)

    def _pose(self, t: float, frame: Frame) -> None:
        """Answer the sensor's gauge requests too, as a node at the same ids does."""
        base = self._board.base << 4
        if t < self._impostor_until and frame.can_id == base and not frame.data:
            self._impostor(Frame(base, bytes([0x37, 2, 1, 0, 0, 0, 7, 7])))
            self._impostor(Frame(base | 1, bytes(6)))

    def _error_frame(self, fault: Fault) -> None:
        count = min(max(1, _number(fault, "count", 1)), 1000)
        self._hub.order(lambda: self._hub.destroy(count))

    def _overload(self, fault: Fault) -> None:
        seconds, share = fault.seconds or 1.0, float(fault.values.get("share", 1.0))
        hub = self._hub
        hub.order(
            lambda: hub.foreign.start(time.monotonic(), seconds, share, hub.wire.load.bitrate)
        )

    def _hang_up(self, _: Fault) -> None:
        self._hub.order(self._hub.hang_up)

    def _stall(self, fault: Fault) -> None:
        self._hub.stalled_until = time.monotonic() + (fault.seconds or 1.0)

    def _garbage(self, fault: Fault) -> None:
        """Frames of any id but NMT, SYNC and those that would reconfigure something."""
        ids = [0x680 + k for k in range(16)] + [0x181, 0x182, 0x081, 0x701, 0x581, 0x123, 0x7FF]
        for _ in range(min(_number(fault, "count", 100), 1000)):
            data = self._chance.randbytes(self._chance.randrange(9))
            self._impostor(Frame(self._chance.choice(ids), data))

    def _garbage_text(self, _: Fault) -> None:
        self._hub.order(lambda: self._hub.say(_GARBAGE_TEXT))

    def _later(self, seconds: float, what: Callable[[], None]) -> None:
        self._hub.later(time.monotonic() + seconds, what)


def _until(fault: Fault) -> float:
    return time.monotonic() + (fault.seconds or _FOREVER)


def _number(fault: Fault, name: str, default: int) -> int:
    value = fault.values.get(name, default)
    if isinstance(value, bool) or not isinstance(value, int):
        raise MapError(f"fault can {fault.kind}: {name} = {value!r} must be a whole number")
    return value
