"""Who uses which id: a sensor whose ids are also a drive's would take targets for commands."""

from collections.abc import Sequence

from wrenchbed.errors import ParameterError

SERVICES = {
    0x080: "EMCY", 0x180: "TPDO1", 0x200: "RPDO1", 0x280: "TPDO2", 0x300: "RPDO2",
    0x380: "TPDO3", 0x400: "RPDO3", 0x480: "TPDO4", 0x500: "RPDO4", 0x580: "SDO answer",
    0x600: "SDO request", 0x700: "heartbeat",
}  # fmt: skip
"""CANopen's predefined connection set: first id of each service of nodes → its name."""
_SHARED = {0x000: "NMT", 0x080: "SYNC", 0x100: "TIME", 0x7E4: "LSS", 0x7E5: "LSS"}
SAFE = 0x68
"""A base whose ids no CANopen service uses: 0x680 … 0x68F."""


def master(base: int, nodes: Sequence[int]) -> int:
    """A node id for this program's own heartbeat: the highest that nobody here uses."""
    return next(n for n in range(127, 0, -1) if n not in nodes and (0x700 + n) >> 4 != base)


def users(nodes: Sequence[int]) -> dict[int, str]:
    """Every id of these CANopen nodes → who uses it."""
    own = {
        first + node: f"{name} of node {node}" for first, name in SERVICES.items() for node in nodes
    }
    return _SHARED | own


def check(base: int, nodes: Sequence[int]) -> None:
    """Refuse nodes that are no nodes, and a sensor whose ids collide with theirs.

    Raises:
        ParameterError: names an id, both of its users, and the remedy.
    """
    if len(set(nodes)) != len(nodes) or not all(1 <= node <= 127 for node in nodes):
        raise ParameterError(f"nodes {tuple(nodes)}: give different numbers from 1 to 127")
    if not 0 <= base <= 0x7F:
        raise ParameterError(f"base 0x{base:X} must be 0 … 0x7F")
    used = users(nodes)
    for can_id in range(base << 4, (base << 4) + 16):
        if can_id in used:
            raise ParameterError(
                f"sensor base 0x{base:02X}: its id 0x{can_id:03X} is {used[can_id]}; its board "
                f"could be reset or moved by a drive's targets: set the board to base "
                f"0x{SAFE:02X}, or the drives to other node ids"
            )
