"""Checks of SDO transfers: expedited, segmented, block, and what a server refuses."""

import struct

from wrenchbed.hardware.conformity.bench import (
    Bench,
    FailedError,
    NotApplicableError,
    RefusedError,
    require,
)
from wrenchbed.hardware.conformity.checks import Checks, Level

CHECKS = Checks()
_SDO = "CiA 301 7.2.4.3"
_ABORTS = "CiA 301 7.2.4.3.17"
_TOGGLE, _COMMAND, _BLOCK_SIZE, _CRC = 0x05030000, 0x05040001, 0x05040002, 0x05040004
_READ_ONLY, _NO_OBJECT, _NO_SUBINDEX = 0x06010002, 0x06020000, 0x06090011
_LONG, _SHORT = (0x06070010, 0x06070012), (0x06070010, 0x06070013)
_UNSTORED = (0x08000000, 0x08000020, 0x08000021, 0x08000022)
_ABSENT = (0x5FFE, 0x9FFE, 0x1FFE, 0x4FFE)
"""Indices that few nodes have."""
_FIXED = ((0x1000, 0, 4), (0x1018, 1, 4), (0x6041, 0, 2), (0x6064, 0, 4), (0x603F, 0, 2),
          (0x6061, 0, 1), (0x6502, 0, 4), (0x1001, 0, 1))  # fmt: skip
"""Objects that nobody may write, with their sizes."""
_SETTING = ((0x6081, 4), (0x6065, 4), (0x6083, 4), (0x6085, 4), (0x1006, 4))
"""Objects with which writing is tried, with their sizes."""


def texts(bench: Bench) -> list[tuple[int, bytes]]:
    """Texts of the node that are longer than an expedited transfer takes."""
    found = []
    for index in (0x1008, 0x1009, 0x100A):
        try:
            text = bench.upload(index)
        except RefusedError:
            continue
        if len(text) > 4:
            found.append((index, text))
    if not found:
        raise NotApplicableError("the drive has no text of more than 4 bytes")
    return found


def longest(bench: Bench) -> tuple[int, bytes]:
    """The longest text of the node, with its index."""
    return max(texts(bench), key=lambda pair: len(pair[1]))


def setting(bench: Bench) -> tuple[int, int, int]:
    """An object that may be written: index, size, its value."""
    for index, size in _SETTING:
        value = bench.optional(index)
        if value is not None:
            return index, size, value
    raise NotApplicableError("the drive has none of the objects with which writing is tried")


def label(bench: Bench) -> tuple[int, bytes]:
    """A text that may be written: index and value."""
    for index in (0x2000, 0x1021):
        try:
            text = bench.upload(index)
            bench.download(index, 0, text)
        except RefusedError:
            continue
        if len(text) > 7:
            return index, text
    raise NotApplicableError("the drive has no text that may be written (0x2000 was tried)")


@CHECKS.rule("sdo.abort.no-object", _ABORTS, Level.READ)
def no_object(bench: Bench) -> None:
    """The read of an object that does not exist is refused with 0x06020000."""
    absent = _ABSENT[:2]
    for index in absent:
        bench.refusal(lambda i=index: bench.upload(i), [_NO_OBJECT], f"read of 0x{index:04X}")  # type: ignore[misc]


@CHECKS.rule("sdo.abort.no-subindex", _ABORTS, Level.READ)
def no_subindex(bench: Bench) -> None:
    """The read of a subindex that does not exist is refused with 0x06090011."""
    bench.refusal(lambda: bench.upload(0x1018, 200), [_NO_SUBINDEX], "read of 0x1018:200")


@CHECKS.rule("sdo.abort.names-object", _SDO, Level.READ)
def names_object(bench: Bench) -> None:
    """An abort names the object of its request."""
    answer = bench.ask(struct.pack("<BHB4x", 0x40, _ABSENT[0], 0x11))
    require(answer[0] == 0x80, "the read of an absent object is not aborted")
    require(
        struct.unpack_from("<HB", answer, 1) == (_ABSENT[0], 0x11),
        "the abort does not name the object of the request",
    )


@CHECKS.rule("sdo.abort.command", _ABORTS, Level.READ)
def command(bench: Bench) -> None:
    """A request with an unknown command specifier is refused with 0x05040001."""
    bench.refusal(
        lambda: bench.checked(struct.pack("<BHB4x", 0xE0, 0x1000, 0), "command 7"),
        [_COMMAND], "a request with command specifier 7",
    )  # fmt: skip


@CHECKS.rule("sdo.abort.segment-without-begin", _ABORTS, Level.READ)
def segment_first(bench: Bench) -> None:
    """A segment is refused where no transfer was begun."""
    bench.send(0x600 + bench.node, b"\x80".ljust(8, b"\0"))
    bench.refusal(
        lambda: bench.checked(b"\x60".ljust(8, b"\0"), "a segment"),
        [_COMMAND, 0x08000000, 0x08000022], "a segment without a transfer",
    )  # fmt: skip


@CHECKS.rule("sdo.expedited.size", _SDO, Level.READ)
def expedited_size(bench: Bench) -> None:
    """An expedited answer states its size, and bytes beyond it are 0."""
    for index, sub, size in ((0x1000, 0, 4), (0x1018, 0, 1), (0x6041, 0, 2)):
        answer = bench.checked(struct.pack("<BHB4x", 0x40, index, sub), f"0x{index:04X}")
        require(answer[0] & 3 == 3, f"0x{index:04X}: answer 0x{answer[0]:02X} states no size")
        told = 4 - (answer[0] >> 2 & 3)
        require(told == size, f"0x{index:04X} has {told} bytes, not {size}")
        require(not any(answer[4 + told :]), f"0x{index:04X}: bytes beyond its size are not 0")


@CHECKS.rule("sdo.segmented.upload", _SDO, Level.READ)
def segmented_upload(bench: Bench) -> None:
    """A segmented read alternates its toggle bit and sends as many bytes as it announced."""
    for index, text in texts(bench):
        require(bench.upload(index) == text, f"0x{index:04X} reads differently a second time")


@CHECKS.rule("sdo.segmented.toggle", _ABORTS, Level.READ)
def segmented_toggle(bench: Bench) -> None:
    """A request for a segment with a wrong toggle bit is refused with 0x05030000."""
    index, _ = longest(bench)
    bench.checked(struct.pack("<BHB4x", 0x40, index, 0), "read")
    bench.refusal(
        lambda: bench.checked(b"\x70".ljust(8, b"\0"), "a segment"),
        [_TOGGLE], "a request with a wrong toggle bit",
    )  # fmt: skip


@CHECKS.rule("sdo.segmented.abort", _SDO, Level.READ)
def segmented_abort(bench: Bench) -> None:
    """After an abort of the client the transfer is over, and another one works."""
    index, text = longest(bench)
    bench.checked(struct.pack("<BHB4x", 0x40, index, 0), "read")
    since = len(bench.log)
    bench.send(0x600 + bench.node, struct.pack("<BHBI", 0x80, index, 0, 0x08000000))
    require(
        bench.wait(0x580 + bench.node, 0.1, since=since) is None, "an abort is answered"
    )  # fmt: skip
    require(bench.upload(index) == text, "the next transfer reads something else")


def _blocks(bench: Bench) -> tuple[int, bytes]:
    """A long text, where the node knows block transfers."""
    index, text = longest(bench)
    try:
        bench.block_upload(index, 0, 127)
    except RefusedError as error:
        if error.code == _COMMAND:
            raise NotApplicableError("the drive has no block transfers") from error
        raise
    return index, text


@CHECKS.rule("sdo.block.upload", _SDO, Level.READ)
def block_upload(bench: Bench) -> None:
    """A block read sends numbered segments, the same bytes as a segmented one, and their CRC."""
    index, text = _blocks(bench)
    for block in (127, 1, 2):
        got = bench.block_upload(index, 0, block)
        require(got == text, f"with blocks of {block} it reads {got!r}, not {text!r}")


@CHECKS.rule("sdo.block.repeat", _SDO, Level.READ)
def block_repeat(bench: Bench) -> None:
    """Segments that the client did not acknowledge are sent again."""
    index, text = _blocks(bench)
    if len(text) <= 7:
        raise NotApplicableError("the longest text has one segment")
    require(bench.block_upload(index, 0, 127, lose=2) == text, "repeated segments differ")


@CHECKS.rule("sdo.block.size", _ABORTS, Level.READ)
def block_size(bench: Bench) -> None:
    """A block read with blocks of 0 or 128 segments is refused with 0x05040002."""
    index, _ = _blocks(bench)
    for size in (0, 128):
        request = struct.pack("<BHBBB2x", 0xA4, index, 0, size, 0)
        bench.refusal(
            lambda r=request: bench.checked(r, "block read"),  # type: ignore[misc]
            [_BLOCK_SIZE], f"a block size of {size}",
        )  # fmt: skip


@CHECKS.rule("sdo.write.read-only", _ABORTS, Level.WRITE)
def read_only(bench: Bench) -> None:
    """The write of a read-only object is refused with 0x06010002, and changes nothing."""
    for index, sub, size in _FIXED:
        before = bench.optional(index, sub)
        if before is None:
            continue
        bench.refusal(
            lambda i=index, s=sub, v=before, n=size: bench.write(i, s, v ^ 1, n),  # type: ignore[misc]
            [_READ_ONLY], f"a write of 0x{index:04X}:{sub}",
        )  # fmt: skip


@CHECKS.rule("sdo.write.absent", _ABORTS, Level.WRITE)
def write_absent(bench: Bench) -> None:
    """The write of an object or subindex that does not exist is refused with its code."""
    bench.refusal(lambda: bench.write(_ABSENT[0], 0, 0, 4), [_NO_OBJECT], "write of no object")
    bench.refusal(
        lambda: bench.write(0x1018, 200, 0, 4), [_NO_SUBINDEX], "write of no subindex"
    )  # fmt: skip


@CHECKS.rule("sdo.write.length", _ABORTS, Level.WRITE)
def write_length(bench: Bench) -> None:
    """A write of too few or too many bytes is refused, and changes nothing."""
    index, size, value = setting(bench)
    bench.refusal(lambda: bench.write(index, 0, value, size - 1), _SHORT, "a write too short")
    bench.refusal(lambda: bench.write(0x1017, 0, 0, 4), _LONG, "a write too long")
    bench.refusal(
        lambda: bench.segmented_download(index, 0, b"\1" * (size + 3)), _LONG,
        "a segmented write too long",
    )  # fmt: skip
    require(bench.read(index) == value, f"0x{index:04X} was changed")


@CHECKS.rule("sdo.write.expedited", _SDO, Level.WRITE)
def write_expedited(bench: Bench) -> None:
    """What was written is read back, with and without a stated size."""
    index, size, value = setting(bench)
    bench.change(index, 0, value + 1, size)
    require(bench.read(index) == value + 1, f"0x{index:04X} does not keep what was written")
    if size == 4:
        request = struct.pack("<BHBI", 0x22, index, 0, value + 2)
        bench.checked(request, "write without size")
        require(bench.read(index) == value + 2, "a write without a stated size is not taken")


@CHECKS.rule("sdo.write.segmented", _SDO, Level.WRITE)
def write_segmented(bench: Bench) -> None:
    """A segmented write is read back."""
    index, size, value = setting(bench)
    bench.change(index, 0, value, size)
    bench.segmented_download(index, 0, (value + 3).to_bytes(size, "little"))
    require(bench.read(index) == value + 3, "a segmented write is not read back")
    where, text = label(bench)
    other = bytes(range(0x30, 0x45))
    bench.segmented_download(where, 0, other)
    got = bench.upload(where)
    bench.segmented_download(where, 0, text)
    require(got == other, f"0x{where:04X} reads {got!r}, and {other!r} was written")


@CHECKS.rule("sdo.write.segmented-toggle", _ABORTS, Level.WRITE)
def write_toggle(bench: Bench) -> None:
    """A segment with a wrong toggle bit is refused with 0x05030000, and nothing is written."""
    index, size, value = setting(bench)
    raw = (value + 4).to_bytes(size, "little")
    try:
        bench.refusal(
            lambda: bench.segmented_download(index, 0, raw, spoil=True), [_TOGGLE],
            "a segment with a wrong toggle bit",
        )  # fmt: skip
    finally:
        if bench.read(index) != value:
            bench.write(index, 0, value, size)
            raise FailedError("a segment with a wrong toggle bit was written")


@CHECKS.rule("sdo.write.block", _SDO, Level.WRITE)
def write_block(bench: Bench) -> None:
    """A block write is read back, also where a segment was lost."""
    index, text = label(bench)
    other = bytes(k % 64 + 0x30 for k in range(61))
    for skip in (0, 3):
        try:
            bench.block_download(index, 0, other, skip=skip)
        except RefusedError as error:
            if error.code == _COMMAND:
                raise NotApplicableError("the drive has no block transfers") from error
            raise
        got = bench.upload(index)
        bench.segmented_download(index, 0, text)
        require(got == other, f"it reads {got!r}, and {other!r} was written")


@CHECKS.rule("sdo.write.block-crc", _ABORTS, Level.WRITE)
def write_crc(bench: Bench) -> None:
    """A block write with a wrong CRC is refused with 0x05040004, and nothing is written."""
    index, text = label(bench)
    try:
        bench.refusal(
            lambda: bench.block_download(index, 0, bytes(20), spoil=True), [_CRC, _COMMAND],
            "a block write with a wrong CRC",
        )  # fmt: skip
    finally:
        if bench.upload(index) != text:
            bench.segmented_download(index, 0, text)
            raise FailedError("data with a wrong CRC were written")


@CHECKS.rule("sdo.store.signature", "CiA 301 7.5.2.13, 7.5.2.14", Level.WRITE)
def signature(bench: Bench) -> None:
    """Parameters are stored and restored only with their signatures."""
    for index in (0x1010, 0x1011):
        if bench.optional(index, 1) is None:
            raise NotApplicableError(f"the drive has no 0x{index:04X}")
        bench.refusal(
            lambda i=index: bench.write(i, 1, 0x12345678, 4), _UNSTORED,  # type: ignore[misc]
            f"a wrong signature in 0x{index:04X}:1",
        )  # fmt: skip
