"""Timed faults of MedRUE's bus, drives and sensor board."""

import random
import time
from collections.abc import Mapping, Sequence

from robot_emulators.base import arguments
from robot_emulators.base.arguments import Argument
from robot_emulators.base.faults import Faults, Handler, LinkFaults, TimedFault
from robot_emulators.can_bus.hub import Hub
from robot_emulators.can_bus.wire import Frame
from robot_emulators.medrue.axis import FOLLOWING_ERROR
from robot_emulators.medrue.board import RESET, SELECT, SET_BASE, SET_BITRATE, BoardEmulator
from robot_emulators.medrue.drive import DriveEmulator

_FOREVER = 1e9
_SETTING = (SELECT, RESET, SET_BASE, SET_BITRATE)
_GARBAGE_TEXT = b"< frame zz >\xff\xfe< nonsense > frame 12"
_SHARE = {"share": arguments.number(0.01, 1.0, 1.0)}


def lasting(faults: Faults, nodes: Sequence[int]) -> LinkFaults:
    """Faults that last for their seconds, 0: until the next of their kind; drives by their node."""
    node = {"node": _one_of(nodes)}
    kinds: dict[str, Mapping[str, Argument]] = {
        "mute": node, "frozen": node, "heartbeat_loss": node,
        "second_frame_lost": _SHARE, "swapped_pair": {}, "mute_board": {}, "id_clash": {},
        "saturated_gauge": {"gauge": arguments.integer(0, 5, 0)},
        "status": {"bits": arguments.integer(1, 0xFFFF, 1 << 4)}, "stall": {},
    }  # fmt: skip
    return LinkFaults(faults, "can", kinds)


def names(active: LinkFaults, node: int, kind: str) -> bool:
    """Whether a fault of a kind is under way that names a node."""
    values = active.now(kind)
    return values is not None and values["node"] == node


class BusFaults:
    """Faults that happen once, and what answers in the sensor's place.

    Args:
        faults: where they are registered.
        active: faults that last.
        hub: the bus.
        drives: on it.
        board: on it.
    """

    def __init__(
        self, faults: Faults, active: LinkFaults, hub: Hub, drives: Sequence[DriveEmulator],
        board: BoardEmulator,
    ) -> None:  # fmt: skip
        self._active, self._hub, self._board = active, hub, board
        self._drives = {drive.node: drive for drive in drives}
        self._random = random.Random(0)
        self._impostor = hub.attach(self._pose, frozenset((board.base << 4,)))
        hub.stalled = lambda: active.now("stall") is not None
        node = {"node": _one_of(list(self._drives))}
        drive, order = self._drive, hub.order
        kinds: dict[str, tuple[Handler, Mapping[str, Argument]]] = {
            "following_error": (lambda f: drive(f).axis.fault(FOLLOWING_ERROR), node),
            "emcy": (
                lambda f: drive(f).axis.fault(int(f.values["code"])),
                node | {"code": arguments.integer(1, 0xFFFF, 0x5441)},
            ),
            "node_reboot": (lambda f: order(drive(f).boot), node),
            "reset_board": (self._reset_board, {"silent": arguments.flag(True)}),
            "error_frame": (
                lambda f: order(lambda: hub.wire.spoil(int(f.values["count"]))),
                {"count": arguments.integer(1, 1000, 1)},
            ),
            "overload": (self._overload, _SHARE),
            "bus_off": (
                lambda f: order(lambda: hub.bus_off(time.monotonic() + (f.seconds or _FOREVER))),
                {},
            ),
            "hub_fin": (lambda f: order(hub.hang_up), {}),
            "garbage_text": (lambda f: order(lambda: hub.say(_GARBAGE_TEXT)), {}),
            "garbage": (self._garbage, {"count": arguments.integer(1, 1000, 100)}),
        }  # fmt: skip
        for kind, (handler, more) in kinds.items():
            faults.on("can", kind, handler, more)

    def _drive(self, fault: TimedFault) -> DriveEmulator:
        return self._drives[int(fault.values["node"])]

    def _reset_board(self, fault: TimedFault) -> None:
        self._board.reset(time.monotonic())
        if not fault.values["silent"]:
            self._board.silent_until = 0.0

    def _pose(self, t: float, frame: Frame) -> None:
        """Answer the sensor's gauge requests too, as a node at the same ids does."""
        base = self._board.base << 4
        if frame.can_id == base and not frame.data and self._active.now("id_clash") is not None:
            self._impostor.send(Frame(base, bytes([0x37, 2, 1, 0, 0, 0, 7, 7])))
            self._impostor.send(Frame(base | 1, bytes(6)))

    def _overload(self, fault: TimedFault) -> None:
        hub, seconds, ratio = self._hub, fault.seconds or 1.0, fault.values["share"]
        hub.order(lambda: hub.foreign.start(time.monotonic(), seconds, ratio, hub.wire.bitrate))

    def _garbage(self, fault: TimedFault) -> None:
        """Frames of any id but NMT, SYNC and those that would reconfigure something."""
        sensor = [self._board.base << 4 | k for k in range(16) if k not in _SETTING]
        ids = [*sensor, 0x181, 0x182, 0x081, 0x701, 0x581, 0x123, 0x7FF]
        for _ in range(int(fault.values["count"])):
            data = self._random.randbytes(self._random.randrange(9))
            self._impostor.send(Frame(self._random.choice(ids), data))


def _one_of(nodes: Sequence[int]) -> Argument:
    """One of some whole numbers, the first where none is given."""
    known = ", ".join(str(node) for node in nodes)
    return Argument(
        lambda v: isinstance(v, int) and not isinstance(v, bool) and v in nodes,
        f"a node: {known}", nodes[0],
    )  # fmt: skip
