"""socket_… of URScript."""

import struct
from collections.abc import Callable
from typing import Any

from robot_emulators.ur.script_links import Link
from robot_emulators.ur.script_program import ScriptProgram, number
from robot_emulators.ur.script_registers import int32
from robot_emulators.ur.urscript.functions import Steps, Table
from robot_emulators.ur.urscript.values import ScriptFaultError, real, shown

TABLE = Table()
_DIAL_S = 2.0
"""How long a connection may take [s]."""
_NAME = "socket_0"
_MOST = 255
"""Numbers that one call can read."""


@TABLE.add()
def socket_open(program: ScriptProgram, address: Any, port: Any, socket_name: Any = _NAME) -> Steps:
    """True once it is connected, False after 2 s."""
    link = program.links.dial(str(address), int(number(port, "a port")), str(socket_name))
    end = program.controller.now + _DIAL_S
    while link is not None and not link.open and not link.lost and program.controller.now < end:
        yield
    if link is not None and link.open:
        return True
    program.links.hang_up(str(socket_name))
    yield
    return False


@TABLE.add()
def socket_close(program: ScriptProgram, socket_name: Any = _NAME) -> None:
    """End a connection."""
    program.links.hang_up(str(socket_name))


def _waited(
    program: ScriptProgram, name: Any, timeout: Any, read: Callable[[Link], bytes | None]
) -> Steps:
    """What a read finds in time; a timeout of zero waits for ever. None without anything.

    A read that finds the connection closed takes a control cycle, so that no program can spin.
    """
    patience = real(timeout, "a timeout")
    end = program.controller.now + patience if patience > 0.0 else float("inf")
    while True:
        link = program.links.of(str(name))
        data = None if link is None else read(link)
        if data is not None:
            return data
        if link is None or link.lost or program.controller.now >= end:
            yield
            return None
        yield


def _count(value: Any) -> int:
    count = int(number(value, "how many numbers"))
    if not 1 <= count <= _MOST:
        raise ScriptFaultError(f"{count} numbers at once: 1 to {_MOST}")
    return count


@TABLE.add()
def socket_read_binary_integer(
    program: ScriptProgram, number: Any, socket_name: Any = _NAME, timeout: Any = 2.0
) -> Steps:
    """How many, then so many 32 bit integers; 0 and not-a-number where they do not come."""
    count = _count(number)
    data = yield from _waited(program, socket_name, timeout, lambda link: link.read(4 * count))
    if data is None:
        return [0] + [float("nan")] * count
    return [count, *struct.unpack(f">{count}i", data)]


@TABLE.add()
def socket_read_byte_list(
    program: ScriptProgram, number: Any, socket_name: Any = _NAME, timeout: Any = 2.0
) -> Steps:
    """How many, then so many bytes; 0 and −1 where they do not come."""
    count = _count(number)
    data = yield from _waited(program, socket_name, timeout, lambda link: link.read(count))
    return [0] + [-1] * count if data is None else [count, *data]


@TABLE.add()
def socket_read_line(program: ScriptProgram, socket_name: Any = _NAME, timeout: Any = 2.0) -> Steps:
    """A line without its end; empty where none comes."""
    data = yield from _waited(program, socket_name, timeout, lambda link: link.until(b"\n"))
    return "" if data is None else data.decode("latin-1").rstrip("\r")


@TABLE.add()
def socket_get_var(
    program: ScriptProgram, name: Any, socket_name: Any = _NAME, timeout: Any = 2.0
) -> Steps:
    """Ask ``GET name``; the whole number of the answer ``name value``, 0 without one."""
    if not _send(program, socket_name, f"GET {shown(name)}\n".encode()):
        yield
        return 0
    words = str((yield from socket_read_line(program, socket_name, timeout))).split()
    answered = len(words) == 2 and words[0] == name and words[1].lstrip("-").isdecimal()
    return int(words[1][:16]) if answered else 0


@TABLE.add()
def socket_set_var(program: ScriptProgram, name: Any, value: Any, socket_name: Any = _NAME) -> bool:
    """Send ``SET name value``."""
    return _send(program, socket_name, f"SET {name} {int(number(value, 'a value'))}\n".encode())


@TABLE.add()
def socket_send_int(program: ScriptProgram, value: Any, socket_name: Any = _NAME) -> bool:
    """Send a 32 bit integer."""
    return _send(program, socket_name, struct.pack(">i", int32(value)))


@TABLE.add()
def socket_send_byte(program: ScriptProgram, value: Any, socket_name: Any = _NAME) -> bool:
    """Send a byte."""
    return _send(program, socket_name, bytes([int(real(value, "a value")) & 0xFF]))


@TABLE.add()
def socket_send_string(program: ScriptProgram, str: Any, socket_name: Any = _NAME) -> bool:
    """Send a text."""
    return _send(program, socket_name, shown(str).encode("latin-1", "replace"))


@TABLE.add()
def socket_send_line(program: ScriptProgram, str: Any, socket_name: Any = _NAME) -> bool:
    """Send a text and a line's end."""
    return _send(program, socket_name, shown(str).encode("latin-1", "replace") + b"\n")


def _send(program: ScriptProgram, name: Any, data: bytes) -> bool:
    link = program.links.of(shown(name))
    return link is not None and link.send(data)
