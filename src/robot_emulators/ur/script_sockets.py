"""socket_… of URScript."""

import struct
from collections.abc import Callable
from typing import Any

from robot_emulators.ur.links import DIAL_S, Link
from robot_emulators.ur.script_program import ScriptProgram
from robot_emulators.ur.script_registers import int32
from robot_emulators.ur.urscript.functions import Steps, Table
from robot_emulators.ur.urscript.values import ScriptFaultError

TABLE = Table()
_NAME = "socket_0"
_MOST = 255
"""Numbers that one call can read."""


@TABLE.add()
def socket_open(
    program: ScriptProgram, address: str, port: float, socket_name: str = _NAME
) -> Steps:
    """True once it is connected, False after 2 s."""
    link = program.links.dial(address, int(port), socket_name)
    end = program.controller.now + DIAL_S
    while link is not None and link.dialling and program.controller.now < end:
        yield
    if link is not None and link.open:
        return True
    program.links.hang_up(socket_name)
    yield
    return False


@TABLE.add()
def socket_close(program: ScriptProgram, socket_name: str = _NAME) -> None:
    """End a connection."""
    program.links.hang_up(socket_name)


def _waited(
    program: ScriptProgram, name: str, timeout: float, read: Callable[[Link], bytes | None]
) -> Steps:
    """Bytes that a read finds before the timeout [s], else None; a timeout of zero never ends.

    A read that finds the connection closed takes a control cycle, so that no program can spin.
    """
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
    """Read ``number`` 32 bit integers: a list of their count and themselves; of 0 and not-a-numbers
    if they do not come in time."""
    count = _count(number)
    data = yield from _waited(program, socket_name, timeout, lambda link: link.read(4 * count))
    if data is None:
        return [0] + [float("nan")] * count
    return [count, *struct.unpack(f">{count}i", data)]


@TABLE.add()
def socket_read_byte_list(
    program: ScriptProgram, number: float, socket_name: str = _NAME, timeout: float = 2.0
) -> Steps:
    """Read ``number`` bytes: a list of their count and themselves; of 0 and −1s if they do not come
    in time."""
    count = _count(number)
    data = yield from _waited(program, socket_name, timeout, lambda link: link.read(count))
    return [0] + [-1] * count if data is None else [count, *data]


@TABLE.add()
def socket_read_line(
    program: ScriptProgram, socket_name: str = _NAME, timeout: float = 2.0
) -> Steps:
    """Read a line without its end; empty if none comes in time."""
    data = yield from _waited(program, socket_name, timeout, lambda link: link.until(b"\n"))
    return "" if data is None else data.decode("latin-1").rstrip("\r")


@TABLE.add()
def socket_get_var(
    program: ScriptProgram, name: str, socket_name: str = _NAME, timeout: float = 2.0
) -> Steps:
    """Ask ``GET name``; the whole number of the answer ``name value``, 0 without one."""
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
    """Send ``SET name value``."""
    return _send(program, socket_name, f"SET {name} {int(value)}\n".encode())


@TABLE.add()
def socket_send_int(program: ScriptProgram, value: Any, socket_name: str = _NAME) -> bool:
    """Send a 32 bit integer."""
    return _send(program, socket_name, struct.pack(">i", int32(value)))


@TABLE.add()
def socket_send_byte(program: ScriptProgram, value: float, socket_name: str = _NAME) -> bool:
    """Send a byte."""
    return _send(program, socket_name, bytes([int(value) & 0xFF]))


@TABLE.add()
def socket_send_string(program: ScriptProgram, str: str, socket_name: str = _NAME) -> bool:
    """Send a text."""
    return _send(program, socket_name, str.encode("latin-1", "replace"))


@TABLE.add()
def socket_send_line(program: ScriptProgram, str: str, socket_name: str = _NAME) -> bool:
    """Send a text and a line's end."""
    return _send(program, socket_name, str.encode("latin-1", "replace") + b"\n")


def _send(program: ScriptProgram, name: str, data: bytes) -> bool:
    link = program.links.of(name)
    return link is not None and link.send(data)
