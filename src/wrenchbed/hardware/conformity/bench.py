"""The client of a node under test: SDO transfers of raw frames, NMT, what came, what to undo.

Source of the protocols: CiA 301, 7.2.4.3 (SDO) and 7.2.8 (NMT).
"""

import struct
from binascii import crc_hqx
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from wrenchbed.errors import WrenchbedError
from wrenchbed.hardware.conformity.port import Port, Received

START, STOP, PRE_OPERATIONAL, RESET_NODE, RESET_COMMUNICATION = 0x01, 0x02, 0x80, 0x81, 0x82
"""NMT commands."""
BOOTED, STOPPED, RUNNING, WAITING = 0x00, 0x04, 0x05, 0x7F
"""NMT states as heartbeats tell them."""
SYNC, OFF = 0x080, 1 << 31
ABORTS = {
    0x05030000: "toggle bit not alternated",
    0x05040000: "SDO protocol timed out",
    0x05040001: "command specifier not valid",
    0x05040002: "invalid block size",
    0x05040003: "invalid sequence number",
    0x05040004: "CRC error",
    0x05040005: "out of memory",
    0x06010000: "unsupported access",
    0x06010001: "read of a write-only object",
    0x06010002: "write of a read-only object",
    0x06020000: "object does not exist",
    0x06040041: "object cannot be mapped",
    0x06040042: "mapped objects exceed a PDO's length",
    0x06040043: "parameters are incompatible",
    0x06040047: "internal incompatibility",
    0x06060000: "hardware error",
    0x06070010: "wrong length",
    0x06070012: "too long",
    0x06070013: "too short",
    0x06090011: "subindex does not exist",
    0x06090030: "invalid value",
    0x06090031: "value too high",
    0x06090032: "value too low",
    0x06090036: "maximum below minimum",
    0x060A0023: "resource not available",
    0x08000000: "general error",
    0x08000020: "cannot be transferred or stored",
    0x08000021: "local control",
    0x08000022: "present state forbids it",
    0x08000023: "no object dictionary",
    0x08000024: "no data available",
}
"""SDO abort codes; source: CiA 301, 7.2.4.3.17."""


class FailedError(WrenchbedError):
    """The node does not do what the standard asks."""


class NotApplicableError(WrenchbedError):
    """A check asks for something that the node does not have."""


class RefusedError(WrenchbedError):
    """An SDO transfer that the node aborted."""

    def __init__(self, code: int, what: str) -> None:
        super().__init__(f"{what}: refused with {abort_words(code)}")
        self.code = code


def abort_words(code: int) -> str:
    """An abort code with its meaning."""
    return f"0x{code:08X} ({ABORTS.get(code, 'no code of CiA 301')})"


def require(holds: bool, why: str) -> None:
    """Fail unless something holds.

    Raises:
        FailedError: with the reason.
    """
    if not holds:
        raise FailedError(why)


@dataclass(frozen=True)
class BenchSettings:
    """What the checks may use.

    Attributes:
        node: id of the drive.
        answer_s: deadline of an answer [s].
        distance: how far the axis may move either way from where it stands [count]; 0: not at all.
        speed: largest speed of it [count/s]; 0: what it takes to go ``distance`` in a second.
        sync_s: period of SYNC in cyclic modes [s].
    """

    node: int
    answer_s: float = 1.0
    distance: int = 0
    speed: int = 0
    sync_s: float = 0.01

    @property
    def pace(self) -> int:
        """Speed of moves [count/s]."""
        return self.speed or max(1, self.distance)


_EVIDENCE = 14
"""Frames of a check that are kept as evidence."""
_LOG = 20000
"""Frames that are kept to look back at."""
_PART = 7


class Bench:
    """A node under test.

    Args:
        port: the bus.
        settings: which node, and what is allowed.
    """

    def __init__(self, port: Port, settings: BenchSettings) -> None:
        self.port, self.settings, self.node = port, settings, settings.node
        self.log: list[Received] = []
        self.origin: int | None = None
        """Where the axis was before the first motion [count]."""
        self.trace: deque[str] = deque(maxlen=_EVIDENCE)
        self._undo: list[tuple[int, int, int, int]] = []

    def begin(self) -> None:
        """A new check: evidence begins anew."""
        self.drain()
        self.trace.clear()
        self.log.clear()

    def send(self, can_id: int, data: bytes, remote: bool = False) -> None:
        """Send a frame."""
        self.trace.append(f"> {can_id:03X} {'remote' if remote else data.hex(' ')}")
        self.port.send(can_id, data, remote)

    def pull(self, seconds: float) -> Received | None:
        """The next frame, which is kept."""
        frame = self.port.receive(seconds)
        if frame is not None:
            self.log.append(frame)
            if len(self.log) > _LOG:
                del self.log[: _LOG // 2]
            if frame.can_id & 0x7F == self.node or frame.can_id == 0x80 + self.node:
                self.trace.append(f"< {frame.can_id:03X} {frame.data.hex(' ')}")
        return frame

    def drain(self) -> None:
        """Take what is there."""
        while self.pull(0.0) is not None:
            pass

    def listen(self, seconds: float) -> list[Received]:
        """Everything that comes within some time [s]."""
        begin, end = len(self.log), self.port.now() + seconds
        while (left := end - self.port.now()) > 0.0:
            self.pull(left)
        return self.log[begin:]

    def wait(
        self, can_id: int, seconds: float, accept: Callable[[bytes], bool] = lambda data: True,
        since: int | None = None,
    ) -> Received | None:  # fmt: skip
        """The next frame of an id, from the ``since``-th of the log on; None at its deadline."""
        at = len(self.log) if since is None else since
        end = self.port.now() + seconds
        while True:
            for frame in self.log[at:]:
                if frame.can_id == can_id and accept(frame.data):
                    return frame
            at = len(self.log)
            left = end - self.port.now()
            if left <= 0.0:
                return None
            self.pull(left)

    def ask(self, request: bytes) -> bytes:
        """The answer to an SDO request.

        Raises:
            FailedError: none came, or it has not 8 bytes.
        """
        self.drain()
        since = len(self.log)
        self.send(0x600 + self.node, request)
        answer = self.wait(0x580 + self.node, self.settings.answer_s, since=since)
        if answer is None:
            raise FailedError(f"no answer to the SDO request {request.hex(' ')}")
        require(len(answer.data) == 8, f"an SDO answer has {len(answer.data)} bytes, not 8")
        return answer.data

    def checked(self, request: bytes, what: str) -> bytes:
        """The answer to an SDO request; raises where it is an abort."""
        answer = self.ask(request)
        if answer[0] == 0x80:
            raise RefusedError(struct.unpack_from("<I", answer, 4)[0], what)
        return answer

    def upload(self, index: int, sub: int = 0) -> bytes:
        """Bytes of an object, by an expedited or a segmented transfer.

        Raises:
            RefusedError: the node aborts.
            FailedError: it answers nothing, or not as the protocol says.
        """
        what = f"0x{index:04X}:{sub}"
        answer = self.checked(struct.pack("<BHB4x", 0x40, index, sub), f"read of {what}")
        require(answer[0] >> 5 == 2, f"{what}: answer 0x{answer[0]:02X} is no upload's")
        require(
            struct.unpack_from("<HB", answer, 1) == (index, sub),
            f"the answer to {what} names another object",
        )
        if answer[0] & 2:
            length = 4 - (answer[0] >> 2 & 3) if answer[0] & 1 else 4
            return answer[4 : 4 + length]
        size = struct.unpack_from("<I", answer, 4)[0] if answer[0] & 1 else None
        return self._segments(what, size)

    def _segments(self, what: str, size: int | None) -> bytes:
        data, toggle = b"", 0
        while True:
            answer = self.checked(bytes([0x60 | toggle << 4]).ljust(8, b"\0"), f"read of {what}")
            require(answer[0] >> 5 == 0, f"{what}: 0x{answer[0]:02X} is no segment")
            require(
                answer[0] >> 4 & 1 == toggle, f"{what}: the toggle bit of a segment is not its own"
            )
            data += answer[1 : 8 - (answer[0] >> 1 & 7)]
            toggle ^= 1
            if answer[0] & 1:
                break
        require(
            size is None or len(data) == size,
            f"{what}: {size} bytes were announced and {len(data)} came",
        )
        return data

    def read(self, index: int, sub: int = 0, signed: bool = False) -> int:
        """An object as a number; raises as `upload` does."""
        return int.from_bytes(self.upload(index, sub), "little", signed=signed)

    def optional(self, index: int, sub: int = 0, signed: bool = False) -> int | None:
        """An object as a number, None where the node refuses."""
        try:
            return self.read(index, sub, signed)
        except RefusedError:
            return None

    def needed(self, index: int, sub: int = 0, signed: bool = False) -> int:
        """An object as a number.

        Raises:
            NotApplicableError: the node does not have it.
        """
        value = self.optional(index, sub, signed)
        if value is None:
            raise NotApplicableError(f"the drive has no 0x{index:04X}:{sub}")
        return value

    def download(self, index: int, sub: int, raw: bytes) -> None:
        """Write an object by an expedited or a segmented transfer; raises as `upload` does."""
        what = f"write of 0x{index:04X}:{sub}"
        if len(raw) <= 4:
            first = 0x23 | (4 - len(raw)) << 2
            request = struct.pack("<BHB", first, index, sub) + raw.ljust(4, b"\0")
            answer = self.checked(request, what)
            require(answer[0] == 0x60, f"{what}: answer 0x{answer[0]:02X} is no download's")
            return
        self.segmented_download(index, sub, raw)

    def segmented_download(self, index: int, sub: int, raw: bytes, spoil: bool = False) -> None:
        """Write an object in segments.

        Args:
            index: of the object.
            sub: subindex.
            raw: its bytes.
            spoil: whether the first segment has a wrong toggle bit.
        """
        what = f"segmented write of 0x{index:04X}:{sub}"
        answer = self.checked(struct.pack("<BHBI", 0x21, index, sub, len(raw)), what)
        require(answer[0] == 0x60, f"{what}: answer 0x{answer[0]:02X} is no download's")
        toggle = 1 if spoil else 0
        for at in range(0, len(raw), _PART):
            part = raw[at : at + _PART]
            last = at + _PART >= len(raw)
            first = toggle << 4 | (_PART - len(part)) << 1 | last
            answer = self.checked(bytes([first]) + part.ljust(_PART, b"\0"), what)
            require(
                answer[0] == 0x20 | toggle << 4, f"{what}: answer 0x{answer[0]:02X} to a segment"
            )
            toggle ^= 1

    def write(self, index: int, sub: int, value: int, size: int) -> None:
        """Write a number; raises as `download` does."""
        self.download(index, sub, (value % (1 << 8 * size)).to_bytes(size, "little"))

    def change(self, index: int, sub: int, value: int, size: int) -> None:
        """Write a number that `restore` takes back."""
        before = self.read(index, sub)
        self.write(index, sub, value, size)
        self._undo.append((index, sub, before, size))

    def restore(self) -> list[str]:
        """Take back all changes, the last one first; what could not be taken back."""
        failed = []
        while self._undo:
            index, sub, value, size = self._undo.pop()
            try:
                self.write(index, sub, value, size)
            except (RefusedError, FailedError) as error:
                failed.append(f"0x{index:04X}:{sub} could not be set back: {error}")
        return failed

    def refusal(self, act: Callable[[], object], codes: Sequence[int], what: str) -> None:
        """Something must be refused with one of some abort codes.

        Raises:
            FailedError: it is not, or with another code.
        """
        try:
            act()
        except RefusedError as error:
            if error.code not in codes:
                expected = " or ".join(abort_words(code) for code in codes)
                raise FailedError(
                    f"{what}: refused with {abort_words(error.code)}, not {expected}"
                ) from error
            return
        raise FailedError(f"{what}: it is taken, and must be refused")

    def nmt(self, command: int) -> None:
        """Send an NMT command to the node alone."""
        self.send(0x000, bytes([command, self.node]))
        self.listen(_SETTLE_S)

    def sync(self) -> None:
        """Send SYNC."""
        self.send(SYNC, b"")

    def block_upload(self, index: int, sub: int, block: int, lose: int = 0) -> bytes:
        """Bytes of an object by a block transfer with CRC.

        Args:
            index: of the object.
            sub: subindex.
            block: segments of a block.
            lose: number of a segment in the first block from which on it is not acknowledged.
        """
        what = f"block read of 0x{index:04X}:{sub}"
        request = struct.pack("<BHBBB2x", 0xA4, index, sub, block, 0)
        answer = self.checked(request, what)
        require(answer[0] & 0xF9 == 0xC0, f"{what}: answer 0x{answer[0]:02X} is no block upload's")
        sized, crc = bool(answer[0] & 2), bool(answer[0] & 4)
        size = struct.unpack_from("<I", answer, 4)[0] if sized else None
        data, last, request = b"", False, b"\xa3".ljust(8, b"\0")
        while not last:
            self.drain()
            since = len(self.log)
            self.send(0x600 + self.node, request)
            parts, taken = self._block(what, block, since)
            if lose and taken >= lose:
                taken, lose, parts = lose - 1, 0, parts[: lose - 1]
                last = False
            else:
                last = bool(parts[-1][0] & 0x80)
            data += b"".join(part[1:] for part in parts)
            request = struct.pack("<BBB5x", 0xA2, taken, block)
        answer = self.checked(request, what)
        require(answer[0] & 0xE3 == 0xC1, f"{what}: answer 0x{answer[0]:02X} does not end it")
        unused = answer[0] >> 2 & 7
        data = data[: len(data) - unused] if unused else data
        self.send(0x600 + self.node, b"\xa1".ljust(8, b"\0"))
        told = struct.unpack_from("<H", answer, 1)[0]
        require(not crc or told == crc_hqx(data, 0), f"{what}: wrong CRC 0x{told:04X}")
        require(
            size is None or size == len(data), f"{what}: announced {size} bytes, sent {len(data)}"
        )
        return data

    def _block(self, what: str, block: int, since: int) -> tuple[list[bytes], int]:
        """Segments of one block, and how many."""
        parts: list[bytes] = []
        at = since
        while len(parts) < block:
            frame = self.wait(0x580 + self.node, self.settings.answer_s, since=at)
            if frame is None:
                raise FailedError(f"{what}: segment {len(parts) + 1} does not come")
            at = self.log.index(frame, at) + 1
            if frame.data[0] == 0x80:
                raise RefusedError(struct.unpack_from("<I", frame.data, 4)[0], what)
            number = frame.data[0] & 0x7F
            require(number == len(parts) + 1, f"{what}: segment {number} comes out of order")
            parts.append(frame.data)
            if frame.data[0] & 0x80:
                break
        return parts, len(parts)

    def block_download(
        self, index: int, sub: int, raw: bytes, spoil: bool = False, skip: int = 0
    ) -> None:  # fmt: skip
        """Write an object by a block transfer with CRC.

        Args:
            index: of the object.
            sub: subindex.
            raw: its bytes.
            spoil: whether the CRC is wrong.
            skip: number of a segment that is left out at first.
        """
        what = f"block write of 0x{index:04X}:{sub}"
        answer = self.checked(struct.pack("<BHBI", 0xC6, index, sub, len(raw)), what)
        require(answer[0] & 0xFB == 0xA0, f"{what}: answer 0x{answer[0]:02X} is no block's")
        crc, block = bool(answer[0] & 4), answer[4]
        require(1 <= block <= 127, f"{what}: block size {block}")
        parts = [raw[at : at + _PART] for at in range(0, len(raw), _PART)]
        begin = 0
        while begin < len(parts):
            now = parts[begin : begin + block]
            answer = self._send_block(what, now, begin + len(now) == len(parts), skip)
            taken = answer[1]
            require(
                taken == (skip - 1 if skip else len(now)),
                f"{what}: {taken} segments are acknowledged",
            )
            begin, block, skip = begin + taken, answer[2], 0
        unused = -len(raw) % _PART
        value = crc_hqx(raw, 0) if crc else 0
        if spoil and not crc:
            raise NotApplicableError("the drive checks no CRC")
        request = struct.pack("<BH5x", 0xC1 | unused << 2, value ^ 0x5A5A if spoil else value)
        answer = self.checked(request, what)
        require(answer[0] == 0xA1, f"{what}: answer 0x{answer[0]:02X} does not end it")

    def _send_block(self, what: str, parts: list[bytes], last: bool, skip: int) -> bytes:
        self.drain()
        since = len(self.log)
        for k, part in enumerate(parts, start=1):
            if k != skip:
                first = k | 0x80 * (last and k == len(parts))
                self.send(0x600 + self.node, bytes([first]) + part.ljust(_PART, b"\0"))
        frame = self.wait(0x580 + self.node, self.settings.answer_s, since=since)
        if frame is None:
            raise FailedError(f"{what}: a block is not acknowledged")
        if frame.data[0] == 0x80:
            raise RefusedError(struct.unpack_from("<I", frame.data, 4)[0], what)
        require(frame.data[0] == 0xA2, f"{what}: answer 0x{frame.data[0]:02X} to a block")
        return frame.data


_SETTLE_S = 0.05
"""How long a node may take to do what an NMT command says [s]; an estimate."""
