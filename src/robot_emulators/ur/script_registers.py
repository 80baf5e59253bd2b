"""Registers, inputs and outputs of URScript."""

from typing import Any

from robot_emulators.ur.script_program import ScriptProgram, number
from robot_emulators.ur.urscript.functions import Table
from robot_emulators.ur.urscript.values import ScriptFaultError, real, truth

TABLE = Table()


def _named(way: str, kind: str, address: Any) -> str:
    where = real(address, "an address")
    if where != int(where):
        raise ScriptFaultError(f"an address must be a whole number, not {where:g}")
    return f"{way}_{kind}_register_{int(where)}"


def _input(program: ScriptProgram, kind: str, address: Any) -> Any:
    name = _named("input", kind, address)
    if name not in program.controller.inputs.values:
        raise ScriptFaultError(f"there is no {name}")
    return program.controller.inputs.values[name][0]


def _output(program: ScriptProgram, kind: str, address: Any) -> str:
    name = _named("output", kind, address)
    if name not in program.controller.fields:
        raise ScriptFaultError(f"there is no {name}")
    return name


@TABLE.add()
def read_input_integer_register(program: ScriptProgram, address: Any) -> int:
    """An input register."""
    return int(_input(program, "int", address))


@TABLE.add("read_input_float_register", "read_input_double_register")
def read_input_float_register(program: ScriptProgram, address: Any) -> float:
    """An input register."""
    return float(_input(program, "double", address))


@TABLE.add()
def read_input_boolean_register(program: ScriptProgram, address: Any) -> bool:
    """An input register; the lower 64 are bits of words."""
    where = int(real(address, "an address"))
    if 0 <= where < 64:
        word = "0_to_31" if where < 32 else "32_to_63"
        bits = program.controller.inputs.values[f"input_bit_registers{word}"][0]
        return bool(bits >> where % 32 & 1)
    return bool(_input(program, "bit", address))


@TABLE.add()
def read_output_integer_register(program: ScriptProgram, address: Any) -> int:
    """An output register."""
    return int(program.controller.values[_output(program, "int", address)][0])


@TABLE.add("read_output_float_register", "read_output_double_register")
def read_output_float_register(program: ScriptProgram, address: Any) -> float:
    """An output register."""
    return float(program.controller.values[_output(program, "double", address)][0])


@TABLE.add()
def read_output_boolean_register(program: ScriptProgram, address: Any) -> bool:
    """An output register."""
    return bool(program.controller.values[_output(program, "bit", address)][0])


@TABLE.add()
def write_output_integer_register(program: ScriptProgram, address: Any, value: Any) -> None:
    """An output register."""
    name, whole = _output(program, "int", address), int(real(value, "a value"))
    if not -(2**31) <= whole < 2**31:
        raise ScriptFaultError(f"{whole} is no 32 bit integer")
    program.controller.values[name] = (whole,)


@TABLE.add("write_output_float_register", "write_output_double_register")
def write_output_float_register(program: ScriptProgram, address: Any, value: Any) -> None:
    """An output register."""
    program.controller.values[_output(program, "double", address)] = (real(value, "a value"),)


@TABLE.add()
def write_output_boolean_register(program: ScriptProgram, address: Any, value: Any) -> None:
    """An output register."""
    program.controller.values[_output(program, "bit", address)] = (truth(value),)


_GROUPS = {"standard": (0, 8), "configurable": (8, 8), "tool": (16, 2)}
"""First bit and number of each group of digital outputs."""


def _bit(group: str, n: Any) -> int:
    first, count = _GROUPS[group]
    k = number(n, "a number of an output")
    if not 0 <= k < count or k != int(k):
        raise ScriptFaultError(f"there is no {group} digital output {k:g}")
    return first + int(k)


def _set(program: ScriptProgram, bit: int, value: Any) -> None:
    bits = program.controller.terminals.bits & ~(1 << bit)
    program.controller.terminals.bits = bits | truth(value) << bit


@TABLE.add("set_standard_digital_out", "set_digital_out")
def set_standard_digital_out(program: ScriptProgram, n: Any, b: Any) -> None:
    """A standard output; of set_digital_out also the tool's, from 8 on."""
    tool = isinstance(n, int | float) and n >= 8
    _set(program, _bit("tool", n - 8) if tool else _bit("standard", n), b)


@TABLE.add()
def set_configurable_digital_out(program: ScriptProgram, n: Any, b: Any) -> None:
    """A configurable output."""
    _set(program, _bit("configurable", n), b)


@TABLE.add()
def set_tool_digital_out(program: ScriptProgram, n: Any, b: Any) -> None:
    """An output of the tool."""
    _set(program, _bit("tool", n), b)


def _is_on(program: ScriptProgram, bit: int) -> bool:
    return bool(program.controller.terminals.bits >> bit & 1)


@TABLE.add("get_standard_digital_out", "get_digital_out")
def get_standard_digital_out(program: ScriptProgram, n: Any) -> bool:
    """A standard output."""
    return _is_on(program, _bit("standard", n))


@TABLE.add()
def get_configurable_digital_out(program: ScriptProgram, n: Any) -> bool:
    """A configurable output."""
    return _is_on(program, _bit("configurable", n))


@TABLE.add()
def get_tool_digital_out(program: ScriptProgram, n: Any) -> bool:
    """An output of the tool."""
    return _is_on(program, _bit("tool", n))


@TABLE.add(
    "get_standard_digital_in", "get_digital_in", "get_configurable_digital_in",
    "get_tool_digital_in",
)  # fmt: skip
def digital_in(program: ScriptProgram, n: Any) -> bool:
    """Nothing is wired to the inputs."""
    number(n, "a number of an input")
    return False


@TABLE.add("get_standard_analog_in", "get_analog_in", "get_tool_analog_in")
def analog_in(program: ScriptProgram, n: Any) -> float:
    """Nothing is wired to the inputs."""
    number(n, "a number of an input")
    return 0.0


@TABLE.add("set_standard_analog_out", "set_analog_out")
def set_standard_analog_out(program: ScriptProgram, n: Any, f: Any) -> None:
    """An analog output, as a share of its range."""
    which = int(number(n, "a number of an output"))
    if which not in (0, 1):
        raise ScriptFaultError(f"there is no analog output {which}")
    program.controller.terminals.analog[which] = min(max(number(f, "a share"), 0.0), 1.0)
