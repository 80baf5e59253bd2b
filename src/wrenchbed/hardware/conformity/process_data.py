"""Checks of process data: how PDOs are mapped and changed, and when they come."""

import itertools
import struct
from collections.abc import Iterator
from contextlib import contextmanager

from wrenchbed.hardware.conformity.bench import (
    OFF,
    PRE_OPERATIONAL,
    START,
    Bench,
    FailedError,
    NotApplicableError,
    RefusedError,
    require,
)
from wrenchbed.hardware.conformity.checks import Checks, Level

CHECKS = Checks()
_TPDO, _RPDO = 0x1800, 0x1400
_MAPPING = 0x200
STATUS, ACTUAL, SHOWN, CONTROL = 0x60410010, 0x60640020, 0x60610008, 0x60400010
_EVENT = 255
_CHANGE = "CiA 301 7.5.2.35 … 7.5.2.38"
_TYPES = "CiA 301 7.2.2.2, 7.5.2.37"
_STATE_CODES = (0x08000022, 0x06090030, 0x06010000, 0x06010002, 0x08000000, 0x08000021, 0x06040043)
"""Codes with which drives refuse a change in the wrong state; CiA 301 prescribes none of them."""


def map_pdo(
    bench: Bench, index: int, entries: tuple[int, ...], kind: int, can_id: int = 0
) -> int:  # fmt: skip
    """Give a PDO a mapping and a type, and switch it on; its id. `Bench.restore` takes it back."""
    before = bench.needed(index, 1)
    used = can_id or before & 0x7FF
    if not used:
        first = 0x180 if index & 0x800 else 0x200
        used = first + 0x100 * (index & 0xF) + bench.node
    bench.change(index, 1, before | OFF, 4)
    bench.change(index + _MAPPING, 0, 0, 1)
    for sub, entry in enumerate(entries, start=1):
        try:
            _put(bench, index + _MAPPING, sub, entry)
        except RefusedError as error:
            if error.code in (0x06020000, 0x06090011, 0x06040041, 0x06010002):
                raise NotApplicableError(f"0x{entry:08X} cannot be mapped there") from error
            raise
    bench.change(index + _MAPPING, 0, len(entries), 1)
    bench.change(index, 2, kind, 1)
    bench.change(index, 1, used | OFF, 4)
    bench.change(index, 1, used, 4)
    return used


def _put(bench: Bench, index: int, sub: int, entry: int) -> None:
    """Write an entry of a mapping; one that was empty stays, beyond the number of entries."""
    if bench.optional(index, sub):
        bench.change(index, sub, entry, 4)
    else:
        bench.write(index, sub, entry, 4)


@contextmanager
def _running(bench: Bench) -> Iterator[None]:
    """OPERATIONAL while the block runs."""
    bench.nmt(START)
    try:
        yield
    finally:
        bench.nmt(PRE_OPERATIONAL)


def _came(bench: Bench, can_id: int, since: int) -> list[bytes]:
    return [f.data for f in bench.log[since:] if f.can_id == can_id]


def _sdo_values(bench: Bench, entries: tuple[int, ...]) -> bytes:
    return b"".join(bench.upload(e >> 16, e >> 8 & 0xFF) for e in entries)


@CHECKS.rule("pdo.change.mapping-on", _CHANGE, Level.WRITE)
def mapping_on(bench: Bench) -> None:
    """The mapping of a PDO that is switched on cannot be changed."""
    for index in (_RPDO, _TPDO):
        word = bench.needed(index, 1)
        count = bench.read(index + _MAPPING)
        if word & OFF:
            bench.change(index, 1, word & ~OFF, 4)
        taken = True
        try:
            bench.write(index + _MAPPING, 0, 0, 1)
        except RefusedError as error:
            require(error.code in _STATE_CODES, str(error))
            taken = False
        if taken:
            bench.write(index + _MAPPING, 0, count, 1)
            raise FailedError(f"0x{index + _MAPPING:04X}:0 is changed while the PDO is on")


@CHECKS.rule("pdo.change.entry-counted", _CHANGE, Level.WRITE)
def entry_counted(bench: Bench) -> None:
    """An entry cannot be changed while the number of entries is not 0."""
    for index in (_RPDO, _TPDO):
        bench.change(index, 1, bench.needed(index, 1) | OFF, 4)
        if not bench.read(index + _MAPPING):
            continue
        entry = bench.read(index + _MAPPING, 1)
        bench.refusal(
            lambda i=index, e=entry: bench.write(i + _MAPPING, 1, e, 4), _STATE_CODES,  # type: ignore[misc]
            f"an entry of 0x{index + _MAPPING:04X} while it is counted",
        )  # fmt: skip


@CHECKS.rule("pdo.change.id-on", _CHANGE, Level.WRITE)
def id_on(bench: Bench) -> None:
    """The id of a PDO that is switched on cannot be changed."""
    for index in (_RPDO, _TPDO):
        word = bench.needed(index, 1)
        if word & OFF:
            bench.change(index, 1, word & ~OFF, 4)
            word &= ~OFF
        bench.refusal(
            lambda i=index, w=word: bench.write(i, 1, w ^ 0x100, 4), _STATE_CODES,  # type: ignore[misc]
            f"another id in 0x{index:04X}:1",
        )  # fmt: skip


@CHECKS.rule("pdo.change.id", _CHANGE, Level.WRITE)
def change_id(bench: Bench) -> None:
    """A PDO that is switched off may get another id, but no restricted one."""
    word = bench.needed(_TPDO, 1)
    bench.change(_TPDO, 1, word | OFF, 4)
    bench.refusal(
        lambda: bench.write(_TPDO, 1, 0x580 + bench.node, 4), _STATE_CODES, "the SDO server's id"
    )  # fmt: skip
    other = 0x480 + bench.node
    entries = (STATUS,)
    used = map_pdo(bench, _TPDO, entries, 1, other)
    with _running(bench):
        since = len(bench.log)
        bench.sync()
        bench.listen(0.05)
        require(bool(_came(bench, used, since)), f"no TPDO at its new id 0x{used:03X}")


@CHECKS.rule("pdo.change.not-mappable", "CiA 301 7.5.2.36, 7.5.2.38", Level.WRITE)
def not_mappable(bench: Bench) -> None:
    """What cannot be mapped is refused with 0x06040041 or 0x06020000."""
    bench.change(_TPDO, 1, bench.needed(_TPDO, 1) | OFF, 4)
    bench.change(_TPDO + _MAPPING, 0, 0, 1)
    absent, constant = 0x5FFE0020, 0x10180120
    for entry in (absent, constant):
        bench.refusal(
            lambda e=entry: bench.write(_TPDO + _MAPPING, 1, e, 4),  # type: ignore[misc]
            [0x06040041, 0x06020000], f"mapping 0x{entry:08X}",
        )  # fmt: skip
    bench.refusal(
        lambda: bench.write(_TPDO + _MAPPING, 1, STATUS & ~0xFF | 0x20, 4),
        [0x06040041, 0x06070010, 0x06090030, 0x06040042], "mapping 32 bits of the statusword",
    )  # fmt: skip
    bench.change(_RPDO, 1, bench.needed(_RPDO, 1) | OFF, 4)
    bench.change(_RPDO + _MAPPING, 0, 0, 1)
    bench.refusal(
        lambda: bench.write(_RPDO + _MAPPING, 1, STATUS, 4),
        [0x06040041, 0x06010002], "the statusword in an RPDO",
    )  # fmt: skip


@CHECKS.rule("pdo.change.too-long", "CiA 301 7.5.2.36, 7.5.2.38", Level.WRITE)
def too_long(bench: Bench) -> None:
    """More than 64 bits are refused with 0x06040042."""
    bench.change(_TPDO, 1, bench.needed(_TPDO, 1) | OFF, 4)
    bench.change(_TPDO + _MAPPING, 0, 0, 1)
    for sub in (1, 2, 3):
        try:
            _put(bench, _TPDO + _MAPPING, sub, ACTUAL)
        except RefusedError as error:
            require(error.code in (0x06040042, 0x06090011), str(error))
            return
    bench.refusal(
        lambda: bench.write(_TPDO + _MAPPING, 0, 3, 1), [0x06040042], "96 bits in a TPDO"
    )  # fmt: skip


@CHECKS.rule("pdo.change.type", "CiA 301 7.5.2.35, 7.5.2.37", Level.WRITE)
def reserved_type(bench: Bench) -> None:
    """A reserved transmission type is refused."""
    for index, kind in ((_RPDO, 241), (_TPDO, 245)):
        before = bench.needed(index, 2)
        bench.change(index, 1, bench.needed(index, 1) | OFF, 4)
        bench.change(index, 2, before, 1)
        bench.refusal(
            lambda i=index, k=kind: bench.write(i, 2, k, 1),  # type: ignore[misc]
            (0x06090030, 0x06090031, 0x06090032), f"type {kind} in 0x{index:04X}:2",
        )  # fmt: skip


@CHECKS.rule("pdo.sync.content", _TYPES, Level.WRITE)
def sync_content(bench: Bench) -> None:
    """A TPDO of type 1 comes once at each SYNC, with the mapped objects in their order."""
    for entries in ((STATUS, ACTUAL), (SHOWN, STATUS), (STATUS,)):
        used = map_pdo(bench, _TPDO, entries, 1)
        with _running(bench):
            since = len(bench.log)
            for _ in range(5):
                bench.sync()
                bench.listen(0.02)
            came = _came(bench, used, since)
            require(len(came) == 5, f"{len(came)} TPDOs at 5 SYNCs")
            size = sum(e & 0xFF for e in entries) // 8
            lengths = {len(data) for data in came}
            require(lengths == {size}, f"TPDOs of {sorted(lengths)} bytes, mapped are {size}")
            word = bench.upload(0x6041)
            at = sum(e & 0xFF for e in entries[: entries.index(STATUS)]) // 8
            require(
                came[-1][at : at + 2] == word,
                f"the TPDO's statusword is {came[-1][at : at + 2].hex()}, 0x6041 {word.hex()}",
            )
        bench.restore()


@CHECKS.rule("pdo.sync.every", _TYPES, Level.WRITE)
def sync_every(bench: Bench) -> None:
    """A TPDO of type 3 comes at every third SYNC."""
    used = map_pdo(bench, _TPDO, (STATUS, ACTUAL), 3)
    with _running(bench):
        since = len(bench.log)
        for _ in range(12):
            bench.sync()
            bench.listen(0.02)
        came = len(_came(bench, used, since))
    require(came == 4, f"{came} TPDOs of type 3 at 12 SYNCs")


@CHECKS.rule("pdo.sync.acyclic", _TYPES, Level.WRITE)
def sync_acyclic(bench: Bench) -> None:
    """A TPDO of type 0 comes at SYNC only, and only where something changed."""
    used = map_pdo(bench, _TPDO, (STATUS,), 0)
    with _running(bench):
        bench.listen(0.05)
        since = len(bench.log)
        for _ in range(6):
            bench.sync()
            bench.listen(0.02)
        came = len(_came(bench, used, since))
    require(came <= 1, f"{came} TPDOs of type 0 while nothing changed")


@CHECKS.rule("pdo.states", "CiA 301 7.3.2", Level.WRITE)
def only_operational(bench: Bench) -> None:
    """No TPDO comes at SYNC in PRE-OPERATIONAL."""
    used = map_pdo(bench, _TPDO, (STATUS, ACTUAL), 1)
    since = len(bench.log)
    for _ in range(3):
        bench.sync()
        bench.listen(0.02)
    require(not _came(bench, used, since), "a TPDO comes in PRE-OPERATIONAL")


@CHECKS.rule("pdo.event.timer", _TYPES, Level.WRITE)
def event_timer(bench: Bench) -> None:
    """A TPDO of type 255 comes at least every 0x1800:5 milliseconds."""
    bench.needed(_TPDO, 5)
    used = map_pdo(bench, _TPDO, (STATUS,), _EVENT)
    bench.change(_TPDO, 5, 50, 2)
    with _running(bench):
        frames = [f for f in bench.listen(1.0) if f.can_id == used]
    gaps = [b.t - a.t for a, b in itertools.pairwise(frames)]
    require(len(gaps) >= 3, f"{len(frames)} TPDOs in 1 s with an event timer of 50 ms")
    mean = sum(gaps) / len(gaps) * 1000.0
    require(38.0 < mean < 62.0, f"a TPDO every {mean:.0f} ms with an event timer of 50 ms")


@CHECKS.rule("pdo.event.quiet", _TYPES, Level.WRITE)
def event_quiet(bench: Bench) -> None:
    """A TPDO of type 255 without event timer stays away while nothing changes, SYNC or not."""
    used = map_pdo(bench, _TPDO, (SHOWN,), _EVENT)
    if bench.optional(_TPDO, 5):
        bench.change(_TPDO, 5, 0, 2)
    with _running(bench):
        bench.listen(0.1)
        since = len(bench.log)
        for _ in range(3):
            bench.sync()
            bench.listen(0.05)
        came = len(_came(bench, used, since))
    require(came == 0, f"{came} TPDOs of type 255 while nothing changed")


@CHECKS.rule("pdo.event.inhibit", "CiA 301 7.5.2.37", Level.WRITE)
def inhibit(bench: Bench) -> None:
    """Two TPDOs of type 255 are at least the inhibit time (0x1800:3) apart."""
    bench.needed(_TPDO, 3)
    bench.needed(_TPDO, 5)
    used = map_pdo(bench, _TPDO, (STATUS,), _EVENT)
    word = bench.read(_TPDO, 1)
    bench.change(_TPDO, 1, word | OFF, 4)
    bench.change(_TPDO, 3, 1000, 2)
    bench.change(_TPDO, 5, 20, 2)
    bench.change(_TPDO, 1, word, 4)
    with _running(bench):
        frames = [f for f in bench.listen(1.0) if f.can_id == used]
    gaps = [b.t - a.t for a, b in itertools.pairwise(frames)]
    require(bool(gaps), "fewer than two TPDOs in 1 s")
    least = min(gaps)
    require(least > 0.085, f"TPDOs {least * 1000:.0f} ms apart, the inhibit time is 100 ms")


@CHECKS.rule("pdo.remote", "CiA 301 7.2.2.2", Level.WRITE)
def remote(bench: Bench) -> None:
    """A TPDO of type 253 comes when a remote frame asks for it."""
    if not bench.port.remote:
        raise NotApplicableError("this interface sends no remote frames")
    try:
        used = map_pdo(bench, _TPDO, (STATUS,), 253)
    except RefusedError as error:
        raise NotApplicableError("the drive has no type 253") from error
    if bench.read(_TPDO, 1) >> 30 & 1:
        raise NotApplicableError("0x1800:1 says that it answers no remote frames")
    with _running(bench):
        since = len(bench.log)
        bench.send(used, b"", remote=True)
        bench.listen(0.1)
        came = _came(bench, used, since)
    require(len(came) == 1, f"{len(came)} TPDOs after a remote frame")


@CHECKS.rule("pdo.several", "CiA 301 7.3.5", Level.WRITE)
def several(bench: Bench) -> None:
    """Several TPDOs are sent at one SYNC, each at its own id with its own objects."""
    if bench.optional(_TPDO + 1, 1) is None:
        raise NotApplicableError("the drive has one TPDO")
    one = map_pdo(bench, _TPDO, (STATUS,), 1)
    two = map_pdo(bench, _TPDO + 1, (STATUS, SHOWN), 1, 0x280 + bench.node)
    with _running(bench):
        since = len(bench.log)
        bench.sync()
        bench.listen(0.05)
        lengths = [[len(d) for d in _came(bench, used, since)] for used in (one, two)]
    require(lengths == [[2], [3]], f"TPDOs of {lengths} bytes, expected are [[2], [3]]")


def _word(bench: Bench) -> int:
    return bench.read(0x6040)


@CHECKS.rule("pdo.receive.event", _TYPES, Level.WRITE)
def receive_event(bench: Bench) -> None:
    """An RPDO of type 255 is taken when it arrives, in OPERATIONAL only."""
    used = map_pdo(bench, _RPDO, (CONTROL,), _EVENT)
    bench.change(0x6040, 0, 0, 2)
    bench.send(used, struct.pack("<H", 0x0200))
    bench.listen(0.05)
    require(_word(bench) == 0, "an RPDO is taken in PRE-OPERATIONAL")
    with _running(bench):
        bench.send(used, struct.pack("<H", 0x0200))
        bench.listen(0.05)
        require(_word(bench) == 0x0200, "an RPDO of type 255 is not taken")
        bench.send(used, struct.pack("<H", 0))
        bench.listen(0.05)


@CHECKS.rule("pdo.receive.sync", _TYPES, Level.WRITE)
def receive_sync(bench: Bench) -> None:
    """An RPDO of type 1 is taken at the next SYNC, not before."""
    used = map_pdo(bench, _RPDO, (CONTROL,), 1)
    bench.change(0x6040, 0, 0, 2)
    with _running(bench):
        bench.send(used, struct.pack("<H", 0x0200))
        bench.listen(0.05)
        before = _word(bench)
        bench.sync()
        bench.listen(0.05)
        after = _word(bench)
        bench.send(used, struct.pack("<H", 0))
        bench.sync()
        bench.listen(0.05)
    require(after == 0x0200, "an RPDO of type 1 is not taken at SYNC")
    require(before == 0, "an RPDO of type 1 is taken before SYNC")


@CHECKS.rule("pdo.receive.short", "CiA 301 7.2.2.3, 7.2.7.1", Level.WRITE)
def receive_short(bench: Bench) -> None:
    """An RPDO that is too short is not taken, and may be told by EMCY 0x8210."""
    used = map_pdo(bench, _RPDO, (CONTROL,), _EVENT)
    bench.change(0x6040, 0, 0, 2)
    with _running(bench):
        since = len(bench.log)
        bench.send(used, b"\x02")
        bench.listen(0.1)
        told = [f.data[:2] for f in bench.log[since:] if f.can_id == 0x80 + bench.node]
        taken = _word(bench)
        bench.send(used, struct.pack("<H", 0))
        bench.listen(0.05)
    require(taken == 0, "an RPDO of one byte is taken for a controlword")
    require(
        all(code in (b"\x10\x82", b"\0\0") for code in told), "another error than 0x8210 is told"
    )
