"""Files of packets: each with its time, direction and peer; bounded and rotated.

A file begins with `MAGIC`. A record is time (`time.monotonic`, double [s]), flags (1: sent by this
machine, 2: names a peer), number of the peer (uint8), length (uint32), all little endian, then the
bytes. Every file names its peers before their first packet. The first file stays, since it holds
what the two sides agreed on; of the others the oldest go.
"""

import struct
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from wrenchbed.errors import RecordingError

MAGIC = b"wrenchbed raw 1\n"
FILE_BYTES, MOST_BYTES = 16 << 20, 1 << 30
"""Size of a file, and of all together; estimates: an hour of RDT at 7 kHz is 1.3 GB."""
_HEAD = struct.Struct("<dBBI")
_SENT, _PEER = 1, 2
_LARGEST = 1 << 20
"""Bytes of the longest packet that is read; estimate."""


class Packet(NamedTuple):
    """Bytes that were received from a peer, or sent to it, at a time of `time.monotonic` [s]."""

    t: float
    peer: str
    sent: bool
    data: bytes


class Capture:
    """Writes packets into a folder; safe to use from several threads.

    Args:
        folder: new or empty.
        file_bytes: from which the next file begins.
        most_bytes: of all files together.

    Raises:
        RecordingError: the folder holds something.
    """

    def __init__(
        self, folder: Path, file_bytes: int = FILE_BYTES, most_bytes: int = MOST_BYTES
    ) -> None:
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise RecordingError(f"{folder}: is not an empty folder: give another for the packets")
        folder.mkdir(parents=True, exist_ok=True)
        self._folder, self._file_bytes, self._most = folder, file_bytes, most_bytes
        self._lock = threading.Lock()
        self._peers: dict[str, int] = {}
        self._file: BinaryIO | None = None
        self._size, self._number = 0, 0

    def add(self, peer: str, data: bytes, sent: bool = False, t: float | None = None) -> None:
        """Keep a packet that came from a peer, or was sent to it, now or at a time [s]."""
        now = time.monotonic() if t is None else t
        with self._lock:
            if self._file is None or self._size >= self._file_bytes:
                self._next()
            if peer not in self._peers:
                self._peers[peer] = len(self._peers)
                self._write(now, _PEER, self._peers[peer], peer.encode())
            self._write(now, _SENT if sent else 0, self._peers[peer], data)

    def close(self) -> None:
        """Write what is buffered; may be called twice."""
        with self._lock:
            if self._file is not None:
                self._file.close()
                self._file, self._size = None, self._file_bytes

    def _write(self, t: float, flags: int, peer: int, data: bytes) -> None:
        assert self._file is not None
        self._file.write(_HEAD.pack(t, flags, peer, len(data)) + data)
        self._size += _HEAD.size + len(data)

    def _next(self) -> None:
        if self._file is not None:
            self._file.close()
        files = sorted(self._folder.glob("*.raw"))
        while (
            len(files) > 1 and sum(f.stat().st_size for f in files) + self._file_bytes > self._most
        ):
            files.pop(1).unlink()
        self._file = (self._folder / f"{self._number:06d}.raw").open("xb")
        self._number += 1
        self._file.write(MAGIC)
        self._size, self._peers = len(MAGIC), {}


def packets(folder: Path) -> Iterator[Packet]:
    """All packets of a folder in the order in which they were kept; a torn last one is left out.

    Raises:
        RecordingError: there are none, or a file is no capture; names it.
    """
    files = sorted(folder.glob("*.raw"))
    if not files:
        raise RecordingError(f"{folder}: holds no packets (*.raw)")
    for path in files:
        yield from _of_file(path)


def _of_file(path: Path) -> Iterator[Packet]:
    peers: dict[int, str] = {}
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise RecordingError(f"{path}: is no file of packets")
        while len(head := file.read(_HEAD.size)) == _HEAD.size:
            t, flags, peer, length = _HEAD.unpack(head)
            if length > _LARGEST or (flags != _PEER and peer not in peers):
                raise RecordingError(f"{path}: damaged at byte {file.tell() - _HEAD.size}")
            data = file.read(length)
            if len(data) < length:
                return
            if flags == _PEER:
                peers[peer] = data.decode(errors="replace")
            else:
                yield Packet(t, peers[peer], bool(flags & _SENT), data)
