"""Checks of the object dictionary: what must be there, of which size, and that values agree."""

from collections.abc import Callable
from typing import NamedTuple

from wrenchbed.hardware.conformity.bench import (
    OFF,
    Bench,
    NotApplicableError,
    RefusedError,
    require,
)
from wrenchbed.hardware.conformity.checks import Check, Checks, Level

CHECKS = Checks()
PP, PV, HM, CSP = 1, 3, 6, 8
"""Modes of operation; source: CiA 402."""
_MODES = {PP: "profile position", PV: "profile velocity", HM: "homing", CSP: "cyclic position"}
ALWAYS = 0
NEVER = -1


class Object(NamedTuple):
    """An object of a standard: its index, subindex, bytes (0: any), modes that need it, its clause.

    ``modes`` holds `ALWAYS` where every drive needs it, and is empty where none does.
    """

    number: int
    sub: int
    size: int
    modes: tuple[int, ...]
    clause: str
    name: str


_301 = (
    (0x1000, 0, 4, (ALWAYS,), "7.5.2.1", "device type"),
    (0x1001, 0, 1, (ALWAYS,), "7.5.2.2", "error register"),
    (0x1003, 0, 1, (), "7.5.2.4", "pre-defined error field"),
    (0x1005, 0, 4, (), "7.5.2.5", "COB-ID SYNC"),
    (0x1006, 0, 4, (), "7.5.2.6", "communication cycle period"),
    (0x1007, 0, 4, (), "7.5.2.7", "synchronous window length"),
    (0x1008, 0, 0, (), "7.5.2.8", "device name"),
    (0x1009, 0, 0, (), "7.5.2.9", "hardware version"),
    (0x100A, 0, 0, (), "7.5.2.10", "software version"),
    (0x100C, 0, 2, (), "7.5.2.11", "guard time"),
    (0x100D, 0, 1, (), "7.5.2.12", "life time factor"),
    (0x1010, 1, 4, (), "7.5.2.13", "store parameters"),
    (0x1011, 1, 4, (), "7.5.2.14", "restore default parameters"),
    (0x1014, 0, 4, (), "7.5.2.17", "COB-ID EMCY"),
    (0x1015, 0, 2, (), "7.5.2.18", "inhibit time EMCY"),
    (0x1016, 1, 4, (), "7.5.2.19", "consumer heartbeat time"),
    (0x1017, 0, 2, (), "7.5.2.20", "producer heartbeat time"),
    (0x1018, 0, 1, (ALWAYS,), "7.5.2.21", "identity object"),
    (0x1018, 1, 4, (ALWAYS,), "7.5.2.21", "vendor"),
    (0x1018, 2, 4, (), "7.5.2.21", "product code"),
    (0x1018, 3, 4, (), "7.5.2.21", "revision number"),
    (0x1018, 4, 4, (), "7.5.2.21", "serial number"),
    (0x1029, 1, 1, (), "7.5.2.32", "error behaviour: communication"),
    (0x1400, 1, 4, (), "7.5.2.35", "RPDO1: COB-ID"),
    (0x1400, 2, 1, (), "7.5.2.35", "RPDO1: transmission type"),
    (0x1600, 0, 1, (), "7.5.2.36", "RPDO1: number of mapped objects"),
    (0x1800, 1, 4, (), "7.5.2.37", "TPDO1: COB-ID"),
    (0x1800, 2, 1, (), "7.5.2.37", "TPDO1: transmission type"),
    (0x1A00, 0, 1, (), "7.5.2.38", "TPDO1: number of mapped objects"),
)
_POSITION, _RAMPED = (PP, HM, CSP), (PP, PV)
_402 = (
    (0x6007, 0, 2, (), "abort connection option code"),
    (0x603F, 0, 2, (), "error code"),
    (0x6040, 0, 2, (ALWAYS,), "controlword"),
    (0x6041, 0, 2, (ALWAYS,), "statusword"),
    (0x605A, 0, 2, (), "quick stop option code"),
    (0x605B, 0, 2, (), "shutdown option code"),
    (0x605C, 0, 2, (), "disable operation option code"),
    (0x605D, 0, 2, (), "halt option code"),
    (0x605E, 0, 2, (), "fault reaction option code"),
    (0x6060, 0, 1, (ALWAYS,), "modes of operation"),
    (0x6061, 0, 1, (ALWAYS,), "modes of operation display"),
    (0x6062, 0, 4, (), "position demand value"),
    (0x6064, 0, 4, _POSITION, "position actual value"),
    (0x6065, 0, 4, (), "following error window"),
    (0x6066, 0, 2, (), "following error time out"),
    (0x6067, 0, 4, (), "position window"),
    (0x6068, 0, 2, (), "position window time"),
    (0x606B, 0, 4, (), "velocity demand value"),
    (0x606C, 0, 4, (PV,), "velocity actual value"),
    (0x606D, 0, 2, (), "velocity window"),
    (0x606E, 0, 2, (), "velocity window time"),
    (0x606F, 0, 2, (), "velocity threshold"),
    (0x6070, 0, 2, (), "velocity threshold time"),
    (0x6071, 0, 2, (4, 10), "target torque"),
    (0x6072, 0, 2, (), "max torque"),
    (0x6075, 0, 4, (), "motor rated current"),
    (0x6076, 0, 4, (), "motor rated torque"),
    (0x6077, 0, 2, (), "torque actual value"),
    (0x6078, 0, 2, (), "current actual value"),
    (0x607A, 0, 4, (PP, CSP), "target position"),
    (0x607C, 0, 4, (), "home offset"),
    (0x607D, 1, 4, (), "software position limit: min"),
    (0x607D, 2, 4, (), "software position limit: max"),
    (0x607E, 0, 1, (), "polarity"),
    (0x607F, 0, 4, (), "max profile velocity"),
    (0x6081, 0, 4, (PP,), "profile velocity"),
    (0x6083, 0, 4, _RAMPED, "profile acceleration"),
    (0x6084, 0, 4, (), "profile deceleration"),
    (0x6085, 0, 4, (), "quick stop deceleration"),
    (0x6086, 0, 2, (), "motion profile type"),
    (0x6098, 0, 1, (HM,), "homing method"),
    (0x6099, 1, 4, (HM,), "homing speed: switch"),
    (0x6099, 2, 4, (HM,), "homing speed: zero"),
    (0x609A, 0, 4, (), "homing acceleration"),
    (0x60C2, 1, 1, (CSP,), "interpolation time period"),
    (0x60C2, 2, 1, (CSP,), "interpolation time index"),
    (0x60F4, 0, 4, (), "following error actual value"),
    (0x60FD, 0, 4, (), "digital inputs"),
    (0x60FF, 0, 4, (PV,), "target velocity"),
    (0x6502, 0, 4, (ALWAYS,), "supported drive modes"),
)
OBJECTS = tuple(Object(i, s, n, m, f"CiA 301 {c}", w) for i, s, n, m, c, w in _301) + tuple(
    Object(i, s, n, m, f"CiA 402-2 0x{i:04X}", w) for i, s, n, m, w in _402
)
"""Objects of CiA 301 and CiA 402 with their sizes and the modes that need them."""


def has_mode(bench: Bench, mode: int) -> bool:
    """Whether a drive has a mode of operation (0x6502)."""
    return bool((bench.optional(0x6502) or 0) >> (mode - 1) & 1)


def need_mode(bench: Bench, mode: int) -> None:
    """Leave a check of a mode that the drive does not have.

    Raises:
        NotApplicableError: it does not.
    """
    if not has_mode(bench, mode):
        raise NotApplicableError(f"the drive has no mode {mode} ({_MODES.get(mode, 'other')})")


def _exists(thing: Object) -> Callable[[Bench], None]:
    def run(bench: Bench) -> None:
        needed = ALWAYS in thing.modes or any(has_mode(bench, m) for m in thing.modes if m > 0)
        try:
            raw = bench.upload(thing.number, thing.sub)
        except RefusedError as error:
            require(not needed, f"it is mandatory, and {error}")
            raise NotApplicableError("optional, and the drive does not have it") from error
        require(
            not thing.size or len(raw) == thing.size,
            f"it has {len(raw)} bytes, not {thing.size}",
        )

    return run


for _object in OBJECTS:
    CHECKS.append(
        Check(
            f"object.{_object.number:04X}.{_object.sub}", _object.clause,
            f"0x{_object.number:04X}:{_object.sub} ({_object.name}) has its size and may be read.",
            Level.READ, _exists(_object),
        )
    )  # fmt: skip


@CHECKS.rule("device.profile", "CiA 301 7.5.2.1, CiA 402-1", Level.READ)
def profile(bench: Bench) -> None:
    """The device type names profile 402, and a servo, stepper, frequency converter or several."""
    kind = bench.read(0x1000)
    require(kind & 0xFFFF == 402, f"0x1000 names profile {kind & 0xFFFF}")
    require(
        bool(kind >> 16 & 0xFF & 0x87), f"0x1000 names the kind of drive 0x{kind >> 16 & 0xFF:02X}"
    )


@CHECKS.rule("device.identity", "CiA 301 7.5.2.21", Level.READ)
def identity(bench: Bench) -> None:
    """The identity has 1 to 4 entries, and all of them may be read."""
    count = bench.read(0x1018)
    require(1 <= count <= 4, f"0x1018:0 is {count}")
    for sub in range(1, count + 1):
        bench.read(0x1018, sub)


@CHECKS.rule("device.ids", "CiA 301 7.3.5", Level.READ)
def ids(bench: Bench) -> None:
    """SYNC, EMCY and the SDO server have valid ids."""
    sync, emergency = bench.optional(0x1005), bench.optional(0x1014)
    require(sync is None or sync & 0x7FF > 0, "0x1005 has no id")
    require(
        emergency is None or bool(emergency & OFF) or emergency & 0x7FF > 0x80,
        f"0x1014 is 0x{emergency or 0:X}",
    )
    for sub, first in ((1, 0x600), (2, 0x580)):
        told = bench.optional(0x1200, sub)
        require(
            told is None or told & 0x7FF == first + bench.node,
            f"0x1200:{sub} is 0x{told or 0:X}, and 0x{first + bench.node:X} is used",
        )


@CHECKS.rule("errors.history", "CiA 301 7.5.2.4", Level.READ)
def history(bench: Bench) -> None:
    """The error history has as many entries as 0x1003:0 tells."""
    count = bench.needed(0x1003)
    for sub in range(1, count + 1):
        require(bench.read(0x1003, sub) & 0xFFFF != 0, f"0x1003:{sub} holds no error")


@CHECKS.rule("errors.register", "CiA 301 7.5.2.2, 7.2.7", Level.READ)
def register(bench: Bench) -> None:
    """In FAULT the error register is not 0 and 0x603F names the error."""
    if bench.read(0x6041) & 0x4F != 0x08:
        raise NotApplicableError("the drive is not in FAULT")
    require(bench.read(0x1001) & 1 == 1, "0x1001 shows no error")
    code = bench.optional(0x603F)
    require(code != 0, "0x603F names no error")


@CHECKS.rule("errors.clear", "CiA 301 7.5.2.4", Level.WRITE)
def clear(bench: Bench) -> None:
    """0 clears the error history; any other number is refused with 0x06090030."""
    bench.needed(0x1003)
    bench.refusal(lambda: bench.write(0x1003, 0, 1, 1), [0x06090030], "1 in 0x1003:0")
    bench.write(0x1003, 0, 0, 1)
    require(bench.read(0x1003) == 0, "the history is not cleared")


@CHECKS.rule("pdo.mappings", "CiA 301 7.5.2.36, 7.5.2.38", Level.READ)
def mappings(bench: Bench) -> None:
    """Every PDO carries objects that exist with the size that is mapped, 64 bits at most."""
    some = False
    for index in (*range(0x1600, 0x1604), *range(0x1A00, 0x1A04)):
        count = bench.optional(index)
        if count is None or count >= 0xFE:
            continue
        some = True
        bits = 0
        for sub in range(1, count + 1):
            entry = bench.read(index, sub)
            size = entry & 0xFF
            bits += size
            if entry >> 16 < 0x20:  # a dummy of some data type
                continue
            raw = bench.upload(entry >> 16, entry >> 8 & 0xFF)
            require(
                8 * len(raw) == size,
                f"0x{index:04X}:{sub} maps {size} bits of an object of {len(raw)} bytes",
            )
        require(bits <= 64, f"0x{index:04X} maps {bits} bits")
    if not some:
        raise NotApplicableError("the drive has no PDOs")


@CHECKS.rule("values.limits", "CiA 402-2 0x607D", Level.READ)
def limits(bench: Bench) -> None:
    """The smallest position is below the largest one."""
    low, high = bench.needed(0x607D, 1, signed=True), bench.needed(0x607D, 2, signed=True)
    require(low < high or low == high == 0, f"0x607D: {low} … {high}")


@CHECKS.rule("values.mode", "CiA 402-2 0x6061, 0x6502", Level.READ)
def mode(bench: Bench) -> None:
    """The mode that is shown is 0, the maker's own, or one of the supported ones."""
    shown, known = bench.read(0x6061, signed=True), bench.read(0x6502)
    require(shown <= 0 or bool(known >> (shown - 1) & 1), f"mode {shown} is not in 0x{known:X}")


@CHECKS.rule("modes.unknown", "CiA 402-2 0x6060", Level.WRITE)
def unknown_mode(bench: Bench) -> None:
    """A mode that the drive does not have is refused, or not shown by 0x6061."""
    known, before = bench.read(0x6502), bench.read(0x6061, signed=True)
    other = next(m for m in (2, 4, 5, 7, 10, 9, 3, 1) if not known >> (m - 1) & 1)
    kept = bench.read(0x6060, signed=True)
    try:
        bench.write(0x6060, 0, other, 1)
    except RefusedError as error:
        require(
            error.code in (0x06090030, 0x06090031, 0x08000022),
            f"mode {other}: {error}",
        )
        return
    bench.listen(0.1)
    shown = bench.read(0x6061, signed=True)
    bench.write(0x6060, 0, kept, 1)
    require(shown == before, f"mode {other} is not in 0x6502, and 0x6061 shows {shown}")


@CHECKS.rule("modes.shown", "CiA 402-2 0x6060, 0x6061", Level.WRITE)
def shown_mode(bench: Bench) -> None:
    """Every supported mode that is written is shown by 0x6061."""
    known = bench.read(0x6502)
    for wanted in (PP, PV, HM, CSP):
        if known >> (wanted - 1) & 1:
            bench.change(0x6060, 0, wanted, 1)
            bench.listen(0.1)
            shown = bench.read(0x6061, signed=True)
            require(shown == wanted, f"mode {wanted} was written, and 0x6061 shows {shown}")
