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
"""Of one part [bytes]: estimate, 64 times the largest default of the writers (4 MiB, mcap)."""
FREE = 2**30
"""All parts of one file may unpack to this size whatever the file's own is [bytes]: estimate."""
RATIO = 200
"""More than `FREE` only up to this multiple of the file's size: estimate, logs reach 3 to 20."""
_STEP = 2**22
"""Unpacked at once [bytes]: estimate."""
_ZSTD = "compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd"


class Unpacker:
    """Unpacks the parts of one file and keeps count of their sizes.

    Args:
        path: the file.
    """

    def __init__(self, path: Path) -> None:
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
            content = b"".join(_limited(_parts([data], kind, where), most, where))
        if size is not None and len(content) != size:
            raise MapError(f"{where}: holds {len(content):,} bytes and states {size:,}: damaged")
        self._total += len(content)
        if self._total > self._most:
            raise MapError(
                f"{where}: unpacks to more than {self._most:,} bytes: damaged, or a bomb"
            )
        return content

    def unpack_file(self, path: Path, kind: str, target: Path) -> None:
        """Unpack a whole file to another one, block by block.

        Raises:
            MapError: as `unpack`.
        """
        with path.open("rb") as source, target.open("wb") as out:
            blocks = iter(lambda: source.read(_STEP), b"")
            for part in _limited(_parts(blocks, kind, str(path)), self._most, str(path)):
                out.write(part)


def _limited(parts: Iterable[bytes], most: int, where: str) -> Iterator[bytes]:
    """The parts, while all of them together are not too large."""
    for part in parts:
        most -= len(part)
        if most < 0:
            raise MapError(f"{where}: unpacks to more than it may: damaged, or a bomb")
        yield part


def _parts(blocks: Iterable[bytes], kind: str, where: str) -> Iterator[bytes]:
    """The content of compressed blocks in parts of at most `_STEP` bytes."""
    decoder = _decoder(kind, where)
    try:
        for block in blocks:
            while block:
                decoder = _decoder(kind, where) if decoder.eof else decoder
                yield decoder.decompress(block, _STEP)
                while not (decoder.eof or decoder.needs_input):
                    yield decoder.decompress(b"", _STEP)
                block = (decoder.unused_data or b"") if decoder.eof else b""
    except (MapError, GeneratorExit):
        raise
    except Exception as error:  # each library has its own, and none a common base
        raise_shortage(error, where)
        why = (str(error) or type(error).__name__).splitlines()[0]
        raise MapError(f"{where}: damaged {kind} data: {why}") from error
    if not decoder.eof:
        raise MapError(f"{where}: its {kind} data end early")


def _decoder(kind: str, where: str) -> Any:
    if kind == "bz2":
        return bz2.BZ2Decompressor()
    if kind == "zstd":
        return registry.require(_ZSTD, "logs").ZstdDecompressor()
    if kind == "lz4":
        return registry.require("lz4.frame", "logs").LZ4FrameDecompressor()
    raise MapError(f"{where}: compressed by {kind!r}; zstd, lz4 and bz2 can be read")
