"""Compressed parts of logs, unpacked within limits: a small file must not fill the memory.

An archive bomb is a few kilobytes that unpack to gigabytes, whatever size they state.
"""

import sys
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import IO

from wrenchbed import registry

LARGEST = 2**28
"""Largest record, and largest unpacked chunk or message [bytes], which is held in memory: 64 times
mcap's default chunk (4 MiB)."""
RATIO = 200
"""Unpacked over packed size, ten times that of a log whose readings hardly change. Parts that may
be beyond it are first unpacked to nowhere; a whole file on the disk may be larger than `LARGEST`
up to it."""
_STEP = 2**18
"""Bytes that are unpacked at once where only the size is asked for."""
_ZSTD = "compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd"
_DECODERS = {
    "bz2": ("bz2", "BZ2Decompressor"),
    "lz4": ("lz4.frame", "LZ4FrameDecompressor"),
    "zstd": (_ZSTD, "ZstdDecompressor"),
}
"""Compression → module and name of its decoder, which unpacks up to a length."""


def unpack(data: bytes, compression: str, stated: int | None) -> bytes:
    """Content of a chunk or message: as long as stated, and never longer than `LARGEST`.

    Args:
        data: the chunk or message as it is stored.
        compression: ``bz2``, ``lz4`` or ``zstd``; empty or ``none`` for what is not compressed.
        stated: size of the content as the file states it [bytes]; None where it does not.

    Raises:
        ValueError: another size, data cut short, or an unknown compression.
    """
    limit, content, complete = LARGEST if stated is None else stated, data, True
    if limit > LARGEST:
        raise ValueError(
            f"{len(data):,} bytes state {limit:,} bytes unpacked, more than {LARGEST:,}: "
            "damaged, or a bomb"
        )
    if compression not in ("", "none"):
        if compression not in _DECODERS:
            raise ValueError(f"compression {compression!r}; {', '.join(_DECODERS)} can be read")
        module, name = _DECODERS[compression]
        library = registry.require(module, "logs")
        if limit > RATIO * len(data):
            _check_size(library.open(BytesIO(data)), len(data), limit)
        decoder = getattr(library, name)()
        content = decoder.decompress(data, max_length=limit + 1)
        complete = decoder.eof and not decoder.unused_data
    if len(content) > limit:
        raise _too_large(len(data), limit)
    if not complete or stated not in (None, len(content)):
        raise ValueError(
            f"{len(data):,} bytes unpack to {len(content):,}, and end early or state another size: "
            "damaged"
        )
    return content


def stated_size(data: bytes) -> int | None:
    """Size to which a zstd frame states that it unpacks [bytes]; None where it does not."""
    size: int | None = registry.require(_ZSTD, "logs").get_frame_info(data).decompressed_size
    return size


def check_file(file: Path) -> None:
    """Refuse a file of a rosbag 2 that is compressed as a whole: rosbags unpacks it to the disk.

    Raises:
        ValueError: it unpacks to more than `LARGEST` and than `RATIO` times its size.
    """
    if not file.is_file():
        return
    zstd = registry.require(_ZSTD, "logs")
    packed = file.stat().st_size
    with suppress(zstd.ZstdError, EOFError):  # not zstd: read as it is
        _check_size(zstd.open(file), packed, max(LARGEST, RATIO * packed), f"{file.name}: ")


def _check_size(stream: IO[bytes], packed: int, limit: int, where: str = "") -> None:
    """Unpack a stream of so many packed bytes to nowhere, and refuse it beyond a limit [bytes]."""
    size = 0
    with stream:
        while size <= limit and (part := stream.read(_STEP)):
            size += len(part)
    if size > limit:
        raise _too_large(packed, limit, where)


def _too_large(packed: int, limit: int, where: str = "") -> ValueError:
    return ValueError(f"{where}{packed:,} bytes unpack to more than {limit:,}: damaged, or a bomb")
