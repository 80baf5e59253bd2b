"""Functions by which a URScript program exchanges data: registers, inputs and outputs, sockets.
A function's name, parameters and defaults are those of Universal Robots' script manual."""

import struct
from collections.abc import Callable
from functools import partial
from typing import Any

from robot_emulators.ur.program_sockets import Link
from robot_emulators.ur.rtde_packets import BIT_REGISTERS
from robot_emulators.ur.script_program import ScriptProgram, dialled
from robot_emulators.ur.urscript.functions import Steps, Table
from robot_emulators.ur.urscript.values import ScriptFaultError, real, shown, truth

TABLE = Table()
_KINDS: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "integer": ("int", int), "float": ("double", float), "boolean": ("bit", bool),
}  # fmt: skip
"""Kind of register in URScript → its name in RTDE, and the type of its values."""
_WORD = 32
"""Bit registers that one RTDE field holds, up to number 63; each later one has its own field."""
_GROUPS = {"standard": (0, 8), "configurable": (8, 8), "tool": (16, 2)}
"""Group of digital outputs → its first bit and number of bits."""
_NAME = "socket_0"
_MOST = 255
"""Most numbers that one call can read."""

_SENT: dict[str, Callable[[Any], bytes]] = {
    "int": lambda value: struct.pack(">i", int32(value)),
    "byte": lambda value: bytes([int(real(value, "a byte")) & 0xFF]),
    "string": lambda value: shown(value).encode("latin-1", "replace"),
}
"""Type in a function's name, as in socket_send_int → converts a value to the bytes to send."""


def _register(way: str, kind: str, address: Any, known: Any) -> tuple[str, int | None]:
    """RTDE field of register number ``address``, and its bit if registers share the field. ``way``:
    input or output; ``kind``: bit, int, double; ``known``: fields that exist. Raises a
    `ScriptFaultError` if the register does not exist."""
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


def _read(
    way: str, kind: str, as_value: Callable[[Any], Any], program: ScriptProgram, address: Any
) -> Any:
    controller = program.controller
    values = controller.inputs.values if way == "input" else controller.values
    name, bit = _register(way, kind, address, values)
    return as_value(values[name][0] >> bit & 1 if bit is not None else values[name][0])


def _write(kind: str, program: ScriptProgram, address: Any, value: Any) -> None:
    values = program.controller.values
    name, bit = _register("output", kind, address, program.controller.fields)
    if bit is not None:
        values[name] = (values[name][0] & ~(1 << bit) | truth(value) << bit,)
    elif kind == "bit":
        values[name] = (truth(value),)
    else:
        values[name] = (real(value, "a value") if kind == "double" else int32(value),)


def int32(value: Any) -> int:
    """Convert a number to an integer; raise `ScriptFaultError` if it does not fit into 32 bits."""
    whole = int(real(value, "a value"))
    if not -(2**31) <= whole < 2**31:
        raise ScriptFaultError(f"{whole} is no 32 bit integer")
    return whole


for _word, (_kind, _type) in _KINDS.items():
    for _way in ("input", "output"):
        TABLE.add(f"read_{_way}_{_word}_register")(partial(_read, _way, _kind, _type))
    TABLE.add(f"write_output_{_word}_register")(partial(_write, _kind))


def _bit(group: str, n: float) -> int:
    """Bit of digital output n of a group in `_GROUPS`; "standard" 8 and 9 are the tool's."""
    if group == "standard" and n >= 8:
        group, n = "tool", n - 8
    first, count = _GROUPS[group]
    if not 0 <= n < count or n != int(n):
        raise ScriptFaultError(f"there is no {group} digital output {n:g}")
    return first + int(n)


def _set_output(group: str, program: ScriptProgram, n: float, b: bool) -> None:
    bit, terminals = _bit(group, n), program.controller.terminals
    terminals.bits = terminals.bits & ~(1 << bit) | b << bit


def _get_output(group: str, program: ScriptProgram, n: float) -> bool:
    return bool(program.controller.terminals.bits >> _bit(group, n) & 1)


for _group in _GROUPS:
    _names = [f"{_group}_digital_out", *(["digital_out"] if _group == "standard" else [])]
    TABLE.add(*(f"set_{name}" for name in _names))(partial(_set_output, _group))
    TABLE.add(*(f"get_{name}" for name in _names))(partial(_get_output, _group))


@TABLE.add(
    "get_standard_digital_in", "get_digital_in", "get_configurable_digital_in",
    "get_tool_digital_in",
)  # fmt: skip
def digital_in(program: ScriptProgram, n: float) -> bool:
    """URScript's digital input ``n``: return False, as nothing is wired to it."""
    return False


@TABLE.add("get_standard_analog_in", "get_analog_in")
def analog_in(program: ScriptProgram, n: float) -> float:
    """URScript's analog input ``n``: return 0, as nothing is wired to it."""
    return 0.0


@TABLE.add("set_standard_analog_out", "set_analog_out")
def set_standard_analog_out(program: ScriptProgram, n: float, f: float) -> None:
    """Set analog output n, 0 or 1, to the fraction f, 0 … 1, of its range."""
    if n not in (0, 1):
        raise ScriptFaultError(f"there is no analog output {n:g}")
    program.controller.terminals.analog[int(n)] = min(max(f, 0.0), 1.0)


@TABLE.add()
def socket_open(
    program: ScriptProgram, address: str, port: float, socket_name: str = _NAME
) -> Steps:
    """Open a TCP connection called socket_name; return True once open, False if not in 2 s."""
    link = yield from dialled(program.controller, program.links, address, int(port), socket_name)
    if link is not None:
        return True
    program.links.hang_up(socket_name)
    yield
    return False


@TABLE.add()
def socket_close(program: ScriptProgram, socket_name: str = _NAME) -> None:
    program.links.hang_up(socket_name)


def _waited(
    program: ScriptProgram, name: str, timeout: float, read: Callable[[Link], bytes | None]
) -> Steps:
    """Wait until ``read`` returns bytes of the connection called ``name``; None after ``timeout``
    [s] (0: never). A read that finds it closed takes a control cycle, so that no program can
    spin."""
    end = program.controller.now + timeout if timeout > 0.0 else float("inf")
    while True:
        link = program.links.of(name)
        data = None if link is None else read(link)
        if data is not None:
            return data
        over = link is None or link.lost or program.controller.now >= end
        yield
        if over:
            return None


def _count(number: float) -> int:
    if not 1 <= number <= _MOST:
        raise ScriptFaultError(f"{number:g} numbers at once: 1 to {_MOST}")
    return int(number)


@TABLE.add()
def socket_read_binary_integer(
    program: ScriptProgram, number: float, socket_name: str = _NAME, timeout: float = 2.0
) -> Steps:
    """Read ``number`` 32-bit integers from connection socket_name; return their count and values,
    or 0 and NaNs if they do not arrive within ``timeout`` [s]."""
    count = _count(number)
    data = yield from _waited(program, socket_name, timeout, lambda link: link.read(4 * count))
    if data is None:
        return [0] + [float("nan")] * count
    return [count, *struct.unpack(f">{count}i", data)]


@TABLE.add()
def socket_read_byte_list(
    program: ScriptProgram, number: float, socket_name: str = _NAME, timeout: float = 2.0
) -> Steps:
    """Read ``number`` bytes from connection socket_name; return their count and values, or 0 and
    −1s if they do not arrive within ``timeout`` [s]."""
    count = _count(number)
    data = yield from _waited(program, socket_name, timeout, lambda link: link.read(count))
    return [0] + [-1] * count if data is None else [count, *data]


@TABLE.add()
def socket_read_line(
    program: ScriptProgram, socket_name: str = _NAME, timeout: float = 2.0
) -> Steps:
    """Read a line from connection socket_name without its end; empty after the timeout [s]."""
    data = yield from _waited(program, socket_name, timeout, lambda link: link.until(b"\n"))
    return "" if data is None else data.decode("latin-1").rstrip("\r")


@TABLE.add()
def socket_get_var(
    program: ScriptProgram, name: str, socket_name: str = _NAME, timeout: float = 2.0
) -> Steps:
    """Send ``GET name`` to connection socket_name; return the integer of the reply ``name value``,
    0 if none comes within the timeout [s]."""
    if not _send(program, socket_name, f"GET {name}\n".encode()):
        yield
        return 0
    words = str((yield from socket_read_line(program, socket_name, timeout))).split()
    answered = len(words) == 2 and words[0] == name and words[1].lstrip("-").isdecimal()
    return int(words[1][:16]) if answered else 0


@TABLE.add()
def socket_set_var(
    program: ScriptProgram, name: str, value: float, socket_name: str = _NAME
) -> bool:
    return _send(program, socket_name, f"SET {name} {int(value)}\n".encode())


def _send_value(
    packed: Callable[[Any], bytes], program: ScriptProgram, value: Any, socket_name: str = _NAME
) -> bool:
    return _send(program, socket_name, packed(value))


for _what, _packed in _SENT.items():
    TABLE.add(f"socket_send_{_what}")(partial(_send_value, _packed))


def _send(program: ScriptProgram, name: str, data: bytes) -> bool:
    link = program.links.of(name)
    return link is not None and link.send(data)
