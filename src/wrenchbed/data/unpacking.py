"""Compressed parts of logs, unpacked within limits: a small file must not fill the memory.

An archive bomb is a few kilobytes that unpack to gigabytes. Sizes that a file states are checked
before anything is unpacked, and no more than stated is unpacked.
"""

import bz2
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from wrenchbed import registry
from wrenchbed.errors import MapError, raise_shortage

LARGEST = 2**28
"""Largest part [bytes], which is held in memory: 64 times mcap's default chunk (4 MiB)."""
FREE = 2**30
"""Size to which a file's parts may always unpack together [bytes]."""
RATIO = 200
"""Largest unpacked size beyond `FREE`, over the file's size: ten times the ratio of a log whose
readings hardly change, a hundredth of a bomb's."""
_STEP = 2**22
"""Unpacked at once [bytes]: a bomb fills no more memory before it is refused."""
_ZSTD = "compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd"


class Unpacker:
    """Unpacks the parts of one file and keeps count of their sizes.

    Args:
        path: the file.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._most = max(FREE, RATIO * path.stat().st_size)
        self._total = 0

    def unpack(self, data: bytes, kind: str, size: int | None, where: str) -> bytes:
        """The content of one part.

        Args:
            data: of the part.
            kind: ``zstd``, ``lz4``, ``bz2``; empty or ``none`` for a part that is not compressed.
            size: that the file states [bytes]; None where it states none.
            where: file and part, for messages.

        Raises:
            MapError: an unknown kind, damaged data, another size than stated, or more than the
                limits allow.
        """
        most = LARGEST if size is None else size
        if most > LARGEST or self._total + (size or 0) > self._most:
            raise MapError(
                f"{where}: states {size or 0:,} bytes unpacked; at most {LARGEST:,} a part and "
                f"{self._most:,} a file are taken"
            )
        content = data
        if kind not in ("", "none"):
            content = b"".join(_unpacked([data], kind, most, where))
        if size is not None and len(content) != size:
            raise MapError(f"{where}: holds {len(content):,} bytes and states {size:,}: damaged")
        self._total += len(content)
        if self._total > self._most:
            raise MapError(
                f"{where}: unpacks to more than {self._most:,} bytes: damaged, or a bomb"
            )
        return content

    def check_file(self, kind: str) -> None:
        """Refuse the whole file if it unpacks to too much, block by block.

        Raises:
            MapError: as `unpack`.
        """
        with self._path.open("rb") as stream:
            blocks = iter(lambda: stream.read(_STEP), b"")
            for _ in _unpacked(blocks, kind, self._most, str(self._path)):
                pass


def _unpacked(blocks: Iterable[bytes], kind: str, most: int, where: str) -> Iterator[bytes]:
    """The content of compressed blocks in parts of at most `_STEP` bytes, at most ``most``."""
    decoder = _decoder(kind, where)
    try:
        for block in blocks:
            rest = block
            while rest or not (decoder.eof or decoder.needs_input):
                decoder = _decoder(kind, where) if decoder.eof else decoder
                part = decoder.decompress(rest, _STEP)
                rest = (decoder.unused_data or b"") if decoder.eof else b""
                most -= len(part)
                if most < 0:
                    raise MapError(f"{where}: unpacks to more than it may: damaged, or a bomb")
                yield part
    except MapError:
        raise
    except Exception as error:  # each library has its own, and none a common base
        raise_shortage(error, where)
        why = (str(error) or type(error).__name__).splitlines()[0]
        raise MapError(f"{where}: damaged {kind} data: {why}") from error
    if not decoder.eof:
        raise MapError(f"{where}: its {kind} data end early")


def _decoder(kind: str, where: str) -> Any:
    """Decoder that unpacks one compressed stream step by step."""
    if kind == "bz2":
        return bz2.BZ2Decompressor()
    if kind == "zstd":
        return registry.require(_ZSTD, "logs").ZstdDecompressor()
    if kind == "lz4":
        return registry.require("lz4.frame", "logs").LZ4FrameDecompressor()
    raise MapError(f"{where}: compressed by {kind!r}; zstd, lz4 and bz2 can be read")
