"""A witness on a bus who shares no code with the driver: plain sockets, socketcand's text."""

import re
import socket
import struct
import threading
import time
from typing import Self

NODES = range(1, 7)
_FRAME = re.compile(rb"< frame ([0-9A-F]{3}) [\d.]+ ([0-9a-f]*) >")
_LONGEST = 64


def connected(host: str, port: int = 29536) -> socket.socket:
    """A connection in raw mode."""
    one = socket.create_connection((host, port), 2.0)
    for command in ("", "< open can0 >", "< rawmode >"):
        one.sendall(command.encode())
        one.recv(64)
    return one


def upload(host: str, node: int, index: int, sub: int = 0, seconds: float = 2.0) -> int:
    """An object of a node, through SDO over a connection of its own."""
    asked = struct.pack("<BHB", 0x40, index, sub)
    with connected(host) as bus:
        words = " ".join(f"{byte:x}" for byte in asked.ljust(8, b"\0"))
        bus.sendall(f"< send {0x600 + node:03X} 8 {words} >".encode())
        got, end = b"", time.monotonic() + seconds
        while time.monotonic() < end:
            got += bus.recv(4096)
            for can_id, data in _FRAME.findall(got):
                raw = bytes.fromhex(data.decode())
                if int(can_id, 16) == 0x580 + node and raw[1:4] == asked[1:4]:
                    assert raw[0] & 0xE0 == 0x40, f"node {node} refuses 0x{index:04X}: {raw.hex()}"
                    return int.from_bytes(raw[4 : 8 - (raw[0] >> 2 & 3)], "little")
    raise AssertionError(f"node {node} does not answer")


def quick_stopped(host: str) -> bool:
    """Whether every drive says that it is in QUICK STOP ACTIVE."""
    return all(upload(host, node, 0x6041) & 0x6F == 0x07 for node in NODES)


class Witness:
    """Hears frames until the block ends, and comes back when it is hung up on; sends nothing.

    Attributes:
        heard: (time [s], id, data) of every frame.
    """

    def __init__(self, host: str) -> None:
        self._host, self._running = host, True
        self.heard: list[tuple[float, int, bytes]] = []
        self._there = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        assert self._there.wait(5.0)
        return self

    def __exit__(self, *_: object) -> None:
        self._running = False
        self._thread.join(5.0)

    def emergencies(self, since: float) -> dict[int, list[int]]:
        """Codes by node that came after a time [s]."""
        found: dict[int, list[int]] = {}
        for t, can_id, data in list(self.heard):
            if t > since and can_id - 0x80 in NODES and len(data) == 8:
                found.setdefault(can_id - 0x80, []).append(struct.unpack_from("<H", data)[0])
        return found

    def all_stopped_themselves(self, since: float) -> bool:
        """Whether every drive has told, after a time [s], that its targets or SYNC stayed away."""
        found = self.emergencies(since)
        return all({0x8250, 0x8700} & set(found.get(node, ())) for node in NODES)

    def _run(self) -> None:
        while self._running:
            try:
                with connected(self._host) as bus:
                    bus.settimeout(0.05)
                    self._there.set()
                    self._listen(bus)
            except OSError:
                time.sleep(0.01)

    def _listen(self, bus: socket.socket) -> None:
        rest = b""
        while self._running:
            try:
                got = bus.recv(65536)
            except TimeoutError:
                continue
            if not got:
                return
            now, rest = time.monotonic(), rest + got
            last = 0
            for match in _FRAME.finditer(rest):
                data = bytes.fromhex(match[2].decode())
                self.heard.append((now, int(match[1], 16), data))
                last = match.end()
            rest = rest[last:][-_LONGEST:]
