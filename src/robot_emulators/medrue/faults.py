"""Timed faults of MedRUE's bus, drives and sensor board."""

import random
import time
from collections.abc import Mapping, Sequence
from functools import partial

from robot_emulators.base import arguments
from robot_emulators.base.arguments import Argument
from robot_emulators.base.faults import Faults, Handler, TimedFault
from robot_emulators.can_bus.hub import Hub
from robot_emulators.can_bus.socketcand import Frame
from robot_emulators.medrue.axis import FOLLOWING_ERROR
from robot_emulators.medrue.board import RESET, SELECT, SET_BASE, SET_BITRATE, BoardEmulator
from robot_emulators.medrue.drive import DriveEmulator

_SETTING = (SELECT, RESET, SET_BASE, SET_BITRATE)
_GARBAGE_TEXT = b"< frame zz >\xff\xfe< nonsense > frame 12"


class BusFaults:
    """Faults of the CAN bus that can be switched on; one is a node in the sensor's place."""

    def __init__(
        self, faults: Faults, hub: Hub, drives: Sequence[DriveEmulator], board: BoardEmulator
    ) -> None:
        self._faults, self._hub, self._board = faults, hub, board
        self._drives = {drive.node: drive for drive in drives}
        self._random = random.Random(0)
        self._impostor = hub.attach(self._pose)
        hub.stalled = lambda: faults.now("can", "stall") is not None
        drive, order = self._drive, hub.order
        node = {"node": _one_of(list(self._drives))}
        count = {"count": arguments.integer(1, 1000, 100)}
        kinds: dict[str, tuple[Handler | None, Mapping[str, Argument]]] = {
            "mute": (None, node), "frozen": (None, node), "heartbeat_loss": (None, node),
            "second_frame_lost": (None, {"share": arguments.number(0.01, 1.0, 1.0)}),
            "swapped_pair": (None, {}), "mute_board": (None, {}), "id_clash": (None, {}),
            "saturated_gauge": (None, {"gauge": arguments.integer(0, 5, 0)}),
            "status": (None, {"bits": arguments.integer(1, 0xFFFF, 1 << 4)}), "stall": (None, {}),
            "following_error": (lambda f: drive(f).axis.fault(FOLLOWING_ERROR), node),
            "emcy": (
                lambda f: drive(f).axis.fault(int(f.values["code"])),
                node | {"code": arguments.integer(1, 0xFFFF, 0x5441)},
            ),
            "node_reboot": (lambda f: order(drive(f).boot), node),
            "reset_board": (self._reset_board, {"silent": arguments.flag(True)}),
            "bus_off": (lambda f: order(partial(hub.bus_off, f.end)), {}),
            "hub_fin": (lambda f: order(hub.hang_up), {}),
            "garbage_text": (lambda f: order(lambda: hub.say(_GARBAGE_TEXT)), {}),
            "garbage": (self._garbage, count),
        }  # fmt: skip
        for kind, (handler, more) in kinds.items():
            faults.on("can", kind, handler, more)

    def names(self, node: int, kind: str) -> bool:
        """Whether a fault of a kind is under way that names a node."""
        values = self._faults.now("can", kind)
        return values is not None and values["node"] == node

    def _drive(self, fault: TimedFault) -> DriveEmulator:
        return self._drives[int(fault.values["node"])]

    def _reset_board(self, fault: TimedFault) -> None:
        self._board.reset(time.monotonic())
        if not fault.values["silent"]:
            self._board.silent_until = 0.0

    def _pose(self, t: float, frame: Frame) -> None:
        """Answer the sensor's gauge requests too, as a node at the same ids does."""
        base = self._board.base << 4
        asked = frame.can_id == base and not frame.data
        if asked and self._faults.now("can", "id_clash") is not None:
            self._impostor(Frame(base, bytes([0x37, 2, 1, 0, 0, 0, 7, 7])))
            self._impostor(Frame(base | 1, bytes(6)))

    def _garbage(self, fault: TimedFault) -> None:
        """Frames of any id but NMT, SYNC and those that would reconfigure something."""
        sensor = [self._board.base << 4 | k for k in range(16) if k not in _SETTING]
        ids = [*sensor, 0x181, 0x182, 0x081, 0x701, 0x581, 0x123, 0x7FF]
        for _ in range(int(fault.values["count"])):
            data = self._random.randbytes(self._random.randrange(9))
            self._impostor(Frame(self._random.choice(ids), data))


def _one_of(nodes: Sequence[int]) -> Argument:
    """One of some whole numbers, the first where none is given."""
    known = ", ".join(str(node) for node in nodes)
    return Argument(
        lambda v: isinstance(v, int) and not isinstance(v, bool) and v in nodes,
        f"a node: {known}", nodes[0],
    )  # fmt: skip
