"""All functions that the emulator gives to URScript, by generation of the controller."""

from robot_emulators.ur import (
    script_math,
    script_motion,
    script_registers,
    script_sockets,
    script_state,
)
from robot_emulators.ur.packets import Version
from robot_emulators.ur.urscript.functions import Table

_ALL = (
    script_math.TABLE | script_registers.TABLE | script_sockets.TABLE | script_state.TABLE
    | script_motion.TABLE
)  # fmt: skip
_SINCE: dict[str, tuple[tuple[int, int], tuple[int, int], tuple[int, int]]] = {
    "direct_torque": ((99, 0), (5, 23), (10, 11)),
    "optimovej": ((99, 0), (5, 21), (10, 8)),
    "optimovel": ((99, 0), (5, 21), (10, 8)),
    "get_actual_joint_positions_history": ((3, 0), (5, 0), (10, 0)),
    "set_target_payload": ((3, 15), (5, 10), (10, 0)),
    "ft_rtde_input_enable": ((3, 14), (5, 9), (10, 0)),
}
"""First software of CB3, e-Series and PolyScope X with a function, as its script manual and the
maker's driver state."""


def functions(version: Version) -> Table:
    """What programs of this software may call."""
    generation = 0 if version[0] < 5 else 1 if version[0] < 10 else 2
    missing = {name for name, since in _SINCE.items() if version[:2] < since[generation]}
    return Table({name: builtin for name, builtin in _ALL.items() if name not in missing})
