"""Compressed parts of logs, unpacked within limits: a small file must not fill the memory.

An archive bomb is a few kilobytes that unpack to gigabytes, whatever size they state.
"""

import sys
from contextlib import suppress
from io import BytesIO
from pathlib import Path

from wrenchbed import registry

LARGEST = 2**28
"""Largest record, and largest unpacked chunk or message [bytes], which is held in memory: 64 times
mcap's default chunk (4 MiB)."""
RATIO = 200
"""Largest unpacked over packed size of a whole file on the disk, if that is more than `LARGEST`:
ten times that of a log whose readings hardly change."""
_STEP = 2**18
"""Bytes that are unpacked at once where only the size is asked for."""
_ZSTD = "compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd"
_LIBRARIES = {"bz2": "bz2", "lz4": "lz4.frame", "zstd": _ZSTD}
"""Compression → module that opens it as a stream, which ends where its checksum is wrong."""


def unpack(data: bytes, compression: str, stated: int | None = None) -> bytes:
    """Decompress a chunk or message to the stated size, and never to more than `LARGEST` bytes.

    Args:
        data: the chunk or message as it is stored.
        compression: ``bz2``, ``lz4`` or ``zstd``; empty or ``none`` for what is not compressed.
        stated: size of the content as the file states it [bytes]; None where it does not.

    Raises:
        ValueError: another size, or an unknown compression.
        EOFError: data cut short.
    """
    content, limit = data, LARGEST if stated is None else stated
    if limit > LARGEST:
        raise ValueError(
            f"{len(data):,} bytes state {limit:,} bytes unpacked, more than {LARGEST:,}: "
            "damaged, or a bomb"
        )
    if compression not in ("", "none"):
        if compression not in _LIBRARIES:
            raise ValueError(f"compression {compression!r}; {', '.join(_LIBRARIES)} can be read")
        with registry.require(_LIBRARIES[compression], "logs").open(BytesIO(data)) as stream:
            content = stream.read(limit + 1)
    if len(content) > limit:
        raise _too_large(len(data), limit)
    if stated not in (None, len(content)):
        raise ValueError(f"{len(data):,} bytes unpack to {len(content):,}, not {stated:,}: damaged")
    return content


def check_file(file: Path) -> None:
    """Check the unpacked size of a rosbag 2 file compressed as a whole: rosbags unpacks it to disk.

    Raises:
        ValueError: it unpacks to more than `LARGEST` and than `RATIO` times its size.
    """
    zstd, packed, size = registry.require(_ZSTD, "logs"), file.stat().st_size, 0
    limit = max(LARGEST, RATIO * packed)
    with suppress(zstd.ZstdError, EOFError), zstd.open(file) as stream:  # others are read as is
        while size <= limit and (part := stream.read(_STEP)):
            size += len(part)
    if size > limit:
        raise _too_large(packed, limit, f"{file.name}: ")


def _too_large(packed: int, limit: int, where: str = "") -> ValueError:
    return ValueError(f"{where}{packed:,} bytes unpack to more than {limit:,}: damaged, or a bomb")
