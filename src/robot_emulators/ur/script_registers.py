"""Registers, inputs and outputs of URScript."""

from collections.abc import Callable
from typing import Any

from robot_emulators.ur.packets import BIT_REGISTERS
from robot_emulators.ur.script_program import ScriptProgram
from robot_emulators.ur.urscript.functions import Table
from robot_emulators.ur.urscript.values import ScriptFaultError, real, truth

TABLE = Table()
_KINDS: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "integer": ("int", int), "float": ("double", float), "boolean": ("bit", bool),
}  # fmt: skip
"""Kind of register in URScript → in RTDE, and the type of its values."""
_WORD = 32
"""Bit registers that RTDE shows in one word; those from 64 on have a field each."""
_GROUPS = {"standard": (0, 8), "configurable": (8, 8), "tool": (16, 2)}
"""First bit and number of each group of digital outputs."""


def _register(way: str, kind: str, address: Any, known: Any) -> tuple[str, int | None]:
    """Field of a register, and its bit where it is one of those that share a word."""
    where = real(address, "an address")
    if where != int(where):
        raise ScriptFaultError(f"an address must be a whole number, not {where:g}")
    number = int(where)
    if kind == "bit" and 0 <= number < BIT_REGISTERS.start:
        first = number // _WORD * _WORD
        return f"{way}_bit_registers{first}_to_{first + _WORD - 1}", number - first
    name = f"{way}_{kind}_register_{number}"
    if name not in known:
        raise ScriptFaultError(f"there is no {name}")
    return name, None


def _reads(way: str, kind: str, as_value: Callable[[Any], Any]) -> Callable[..., Any]:
    def read(program: ScriptProgram, address: Any) -> Any:
        controller = program.controller
        values = controller.inputs.values if way == "input" else controller.values
        name, bit = _register(way, kind, address, values)
        return as_value(values[name][0] >> bit & 1 if bit is not None else values[name][0])

    return read


def _writes(kind: str) -> Callable[..., None]:
    def write(program: ScriptProgram, address: Any, value: Any) -> None:
        values = program.controller.values
        name, bit = _register("output", kind, address, program.controller.fields)
        if bit is not None:
            values[name] = (values[name][0] & ~(1 << bit) | truth(value) << bit,)
        elif kind == "bit":
            values[name] = (truth(value),)
        else:
            values[name] = (real(value, "a value") if kind == "double" else int32(value),)

    return write


def int32(value: Any) -> int:
    """A whole number of 32 bits."""
    whole = int(real(value, "a value"))
    if not -(2**31) <= whole < 2**31:
        raise ScriptFaultError(f"{whole} is no 32 bit integer")
    return whole


for _word, (_kind, _type) in _KINDS.items():
    for _way in ("input", "output"):
        TABLE.add(f"read_{_way}_{_word}_register")(_reads(_way, _kind, _type))
    TABLE.add(f"write_output_{_word}_register")(_writes(_kind))


def _bit(group: str, n: float) -> int:
    """Number of an output's bit; standard outputs from 8 on are the tool's."""
    if group == "standard" and n >= 8:
        group, n = "tool", n - 8
    first, count = _GROUPS[group]
    if not 0 <= n < count or n != int(n):
        raise ScriptFaultError(f"there is no {group} digital output {n:g}")
    return first + int(n)


def _sets(group: str) -> Callable[..., None]:
    def set_output(program: ScriptProgram, n: float, b: bool) -> None:
        bit, terminals = _bit(group, n), program.controller.terminals
        terminals.bits = terminals.bits & ~(1 << bit) | b << bit

    return set_output


def _gets(group: str) -> Callable[..., bool]:
    def get_output(program: ScriptProgram, n: float) -> bool:
        return bool(program.controller.terminals.bits >> _bit(group, n) & 1)

    return get_output


for _group in _GROUPS:
    _names = [f"{_group}_digital_out", *(["digital_out"] if _group == "standard" else [])]
    TABLE.add(*(f"set_{name}" for name in _names))(_sets(_group))
    TABLE.add(*(f"get_{name}" for name in _names))(_gets(_group))


@TABLE.add(
    "get_standard_digital_in", "get_digital_in", "get_configurable_digital_in",
    "get_tool_digital_in",
)  # fmt: skip
def digital_in(program: ScriptProgram, n: float) -> bool:
    """Nothing is wired to the inputs."""
    return False


@TABLE.add("get_standard_analog_in", "get_analog_in")
def analog_in(program: ScriptProgram, n: float) -> float:
    """Nothing is wired to the inputs."""
    return 0.0


@TABLE.add("set_standard_analog_out", "set_analog_out")
def set_standard_analog_out(program: ScriptProgram, n: float, f: float) -> None:
    """An analog output, as a fraction of its range."""
    if n not in (0, 1):
        raise ScriptFaultError(f"there is no analog output {n:g}")
    program.controller.terminals.analog[int(n)] = min(max(f, 0.0), 1.0)
