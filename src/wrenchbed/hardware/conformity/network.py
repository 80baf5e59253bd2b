"""Checks of NMT, heartbeats, guarding, SYNC and emergencies."""

from wrenchbed.hardware.conformity.bench import (
    BOOTED,
    PRE_OPERATIONAL,
    RESET_COMMUNICATION,
    RESET_NODE,
    RUNNING,
    START,
    STOP,
    STOPPED,
    WAITING,
    Bench,
    NotApplicableError,
    RefusedError,
    require,
)
from wrenchbed.hardware.conformity.checks import Checks, Level
from wrenchbed.hardware.conformity.process_data import CONTROL, map_pdo

CHECKS = Checks()
_NMT = "CiA 301 7.2.8.2.1, 7.3.2"
_BEAT_MS = 100
_BEATS = 10
_TOLERANCE = 0.15
"""How far the mean of a heartbeat's period may be off; an estimate that lets a busy bus pass."""
_BOOT_S = 5.0
"""How long a node may take to boot [s]; an estimate."""
OTHER = 0x7D
"""Node id that this program takes for its own heartbeat."""
LOST, SHORT_PDO = 0x8130, 0x8210
"""A heartbeat or guarding stays away; an RPDO is too short. Source: CiA 301, 7.2.7.1."""


def heartbeats(bench: Bench, seconds: float) -> list[tuple[float, int]]:
    """Time [s] and state of the node's heartbeats within some time [s]."""
    frames = bench.listen(seconds)
    return [(f.t, f.data[0]) for f in frames if f.can_id == 0x700 + bench.node and f.data]


def state(bench: Bench) -> int:
    """NMT state by the next heartbeat, which is switched on for it."""
    bench.change(0x1017, 0, _BEAT_MS, 2)
    return _next_state(bench)


def _next_state(bench: Bench) -> int:
    heard = heartbeats(bench, 3 * _BEAT_MS / 1000.0)
    require(bool(heard), f"no heartbeat within {3 * _BEAT_MS} ms")
    return heard[-1][1]


@CHECKS.rule("heartbeat.running", "CiA 301 7.2.8.3.2.2", Level.READ)
def running(bench: Bench) -> None:
    """The heartbeat that is switched on comes in its period, with a known state."""
    period = bench.optional(0x1017)
    if not period:
        raise NotApplicableError("0x1017 is 0: no heartbeat is switched on")
    if period > 2000:
        raise NotApplicableError(f"a heartbeat every {period} ms is too slow to be measured")
    _measured(bench, period)


@CHECKS.rule("heartbeat.period", "CiA 301 7.5.2.20", Level.WRITE)
def produced(bench: Bench) -> None:
    """A heartbeat comes every 0x1017 milliseconds, and none at 0."""
    bench.needed(0x1017)
    bench.change(0x1017, 0, _BEAT_MS, 2)
    _measured(bench, _BEAT_MS)
    bench.write(0x1017, 0, 0, 2)
    bench.listen(0.05)
    require(not heartbeats(bench, 0.35), "heartbeats come although 0x1017 is 0")


def _measured(bench: Bench, period: int) -> None:
    heard = heartbeats(bench, (_BEATS + 1) * period / 1000.0)
    require(len(heard) >= 3, f"{len(heard)} heartbeats in {_BEATS + 1} periods of {period} ms")
    mean = (heard[-1][0] - heard[0][0]) / (len(heard) - 1) * 1000.0
    require(abs(mean / period - 1.0) < _TOLERANCE, f"a heartbeat every {mean:.0f} ms, not {period}")
    states = {s for _, s in heard}
    require(states <= {STOPPED, RUNNING, WAITING}, f"states {sorted(states)} in heartbeats")


@CHECKS.rule("nmt.states", _NMT, Level.WRITE)
def states(bench: Bench) -> None:
    """NMT commands lead to OPERATIONAL, STOPPED and PRE-OPERATIONAL, as the heartbeat tells."""
    bench.needed(0x1017)
    bench.change(0x1017, 0, _BEAT_MS, 2)
    leads = {START: RUNNING, STOP: STOPPED, PRE_OPERATIONAL: WAITING}
    for command in (START, STOP, PRE_OPERATIONAL, STOP, START, PRE_OPERATIONAL):
        expected = leads[command]
        bench.nmt(command)
        told = _next_state(bench)
        require(told == expected, f"after command 0x{command:02X} the heartbeat says 0x{told:02X}")


@CHECKS.rule("nmt.stopped", _NMT, Level.WRITE)
def stopped(bench: Bench) -> None:
    """A stopped node answers no SDO."""
    bench.nmt(STOP)
    since = len(bench.log)
    bench.send(0x600 + bench.node, b"\x40\x00\x10\x00".ljust(8, b"\0"))
    answer = bench.wait(0x580 + bench.node, 0.2, since=since)
    bench.nmt(PRE_OPERATIONAL)
    require(answer is None, "it answers an SDO request in STOPPED")


@CHECKS.rule("nmt.sdo", _NMT, Level.WRITE)
def served(bench: Bench) -> None:
    """SDO works in PRE-OPERATIONAL and in OPERATIONAL."""
    for command in (PRE_OPERATIONAL, START):
        bench.nmt(command)
        bench.read(0x1000)


@CHECKS.rule("nmt.unknown", _NMT, Level.WRITE)
def unknown(bench: Bench) -> None:
    """A command that does not exist, or one for no node, changes no state."""
    before = state(bench)
    bench.send(0x000, bytes([0x55, bench.node]))
    bench.send(0x000, bytes([START]))
    told = _next_state(bench)
    require(told == before, f"the state changed from 0x{before:02X} to 0x{told:02X}")


@CHECKS.rule("nmt.boot-up", "CiA 301 7.2.8.3.3", Level.WRITE)
def boot_up(bench: Bench) -> None:
    """After each reset one boot-up message comes, and the node is in PRE-OPERATIONAL."""
    for command in (RESET_COMMUNICATION, RESET_NODE):
        bench.nmt(START)
        since = len(bench.log)
        bench.send(0x000, bytes([command, bench.node]))
        booted = bench.wait(0x700 + bench.node, _BOOT_S, lambda d: d == bytes([BOOTED]), since)
        require(booted is not None, f"no boot-up message after NMT command 0x{command:02X}")
        bench.listen(0.2)
        if bench.optional(0x1017) is not None:
            told = state(bench)
            require(told == WAITING, f"after the reset its state is 0x{told:02X}")
            bench.restore()


@CHECKS.rule("nmt.reset-defaults", "CiA 301 7.3.2.2.1", Level.WRITE)
def reset_defaults(bench: Bench) -> None:
    """A reset of the communication brings the heartbeat's period back."""
    before = bench.needed(0x1017)
    bench.write(0x1017, 0, before + 77, 2)
    since = len(bench.log)
    bench.send(0x000, bytes([RESET_COMMUNICATION, bench.node]))
    bench.wait(0x700 + bench.node, _BOOT_S, lambda d: d == bytes([BOOTED]), since)
    bench.listen(0.2)
    got = bench.read(0x1017)
    if got != before:
        bench.write(0x1017, 0, before, 2)
    require(got != before + 77, "0x1017 keeps its value over a reset of the communication")


@CHECKS.rule("heartbeat.consumer", "CiA 301 7.5.2.19, 7.5.2.32", Level.WRITE)
def consumer(bench: Bench) -> None:
    """A heartbeat that stays away is an EMCY 0x8130, and 0x1029 decides on the state."""
    bench.needed(0x1016, 1)
    for behaviour, expected in ((1, RUNNING), (2, STOPPED), (0, WAITING)):
        if behaviour != 0 and bench.optional(0x1029, 1) is None:
            continue
        if bench.optional(0x1029, 1) is not None:
            bench.change(0x1029, 1, behaviour, 1)
        bench.change(0x1017, 0, _BEAT_MS, 2)
        bench.change(0x1016, 1, OTHER << 16 | 150, 4)
        bench.nmt(START)
        before = len(bench.log)
        for _ in range(5):
            bench.send(0x700 + OTHER, bytes([RUNNING]))
            bench.listen(0.05)
        since = len(bench.log)
        early = [f for f in bench.log[before:] if f.can_id == 0x80 + bench.node]
        require(not early, "an EMCY comes although heartbeats do")
        found = _emergency(bench, LOST, 0.5, since)
        require(found is not None, "no EMCY 0x8130 although the heartbeat stayed away")
        told = _next_state(bench)
        require(
            told == expected, f"0x1029:1 is {behaviour}, and the state is 0x{told:02X} after it"
        )
        bench.nmt(PRE_OPERATIONAL)
        bench.send(0x700 + OTHER, bytes([RUNNING]))
        bench.restore()


def _emergency(bench: Bench, code: int, seconds: float, since: int) -> bytes | None:
    found = bench.wait(
        0x80 + bench.node, seconds, lambda d: int.from_bytes(d[:2], "little") == code, since
    )
    return None if found is None else found.data


@CHECKS.rule("heartbeat.duplicate", "CiA 301 7.5.2.19", Level.WRITE)
def duplicate(bench: Bench) -> None:
    """The same node in two entries of 0x1016 is refused with 0x06040043."""
    bench.needed(0x1016, 1)
    if bench.optional(0x1016, 2) is None:
        raise NotApplicableError("0x1016 has one entry")
    bench.change(0x1016, 1, OTHER << 16 | 500, 4)
    bench.refusal(
        lambda: bench.write(0x1016, 2, OTHER << 16 | 700, 4), [0x06040043],
        "one node in two entries",
    )  # fmt: skip


@CHECKS.rule("emergency.message", "CiA 301 7.2.7, 7.5.2.2, 7.5.2.4", Level.WRITE)
def emergency(bench: Bench) -> None:
    """An EMCY has 8 bytes, agrees with the error register, heads the history, and 0 ends it."""
    bench.needed(0x1016, 1)
    bench.change(0x1016, 1, OTHER << 16 | 150, 4)
    kept = bench.optional(0x1003)
    since = len(bench.log)
    bench.send(0x700 + OTHER, bytes([RUNNING]))
    data = _emergency(bench, LOST, 1.0, since)
    require(data is not None, "no EMCY 0x8130 although the heartbeat stayed away")
    assert data is not None
    require(len(data) == 8, f"the EMCY has {len(data)} bytes")
    register = bench.read(0x1001)
    require(data[2] == register, f"EMCY and 0x1001 differ: 0x{data[2]:02X}, 0x{register:02X}")
    require(register & 0x11 == 0x11, f"0x1001 is 0x{register:02X}: generic and communication")
    if kept is not None:
        require(bench.read(0x1003) >= 1, "0x1003 has no entry after an EMCY")
        newest = bench.read(0x1003, 1) & 0xFFFF
        require(newest == LOST, f"0x1003:1 is 0x{newest:04X}, not the newest error")
    since = len(bench.log)
    bench.send(0x700 + OTHER, bytes([RUNNING]))
    gone = _emergency(bench, 0, 0.1, since)
    require(gone is not None, "no EMCY 0x0000 after the error is gone")


@CHECKS.rule("emergency.order", "CiA 301 7.5.2.4", Level.WRITE)
def order(bench: Bench) -> None:
    """Of two errors the newer one heads the history, and the older one follows."""
    bench.needed(0x1003)
    bench.needed(0x1016, 1)
    used = map_pdo(bench, 0x1400, (CONTROL,), 255)
    bench.change(0x1016, 1, OTHER << 16 | 150, 4)
    if bench.optional(0x1029, 1) is not None:
        bench.change(0x1029, 1, 1, 1)
    bench.nmt(START)
    bench.send(0x700 + OTHER, bytes([RUNNING]))
    bench.listen(0.4)
    since = len(bench.log)
    bench.send(used, b"\0")
    newer = _emergency(bench, SHORT_PDO, 0.2, since)
    bench.send(used, b"\0\0")
    bench.send(0x700 + OTHER, bytes([RUNNING]))
    bench.listen(0.05)
    if newer is None:
        raise NotApplicableError("a short RPDO, the second error of this check, sends no EMCY")
    first, second = (bench.read(0x1003, sub) & 0xFFFF for sub in (1, 2))
    require(
        (first, second) == (SHORT_PDO, LOST),
        f"after 0x{LOST:04X} and 0x{SHORT_PDO:04X} it begins with 0x{first:04X}, 0x{second:04X}",
    )


@CHECKS.rule("emergency.off", "CiA 301 7.5.2.17", Level.WRITE)
def emergency_off(bench: Bench) -> None:
    """No EMCY is sent while bit 31 of 0x1014 is set."""
    bench.needed(0x1016, 1)
    identifier = bench.needed(0x1014)
    try:
        bench.change(0x1014, 0, identifier | 1 << 31, 4)
    except RefusedError as error:
        raise NotApplicableError("0x1014 cannot be switched off") from error
    bench.change(0x1016, 1, OTHER << 16 | 150, 4)
    bench.send(0x700 + OTHER, bytes([RUNNING]))
    frames = bench.listen(0.4)
    bench.send(0x700 + OTHER, bytes([RUNNING]))
    bench.listen(0.02)
    require(
        not [f for f in frames if f.can_id == 0x80 + bench.node], "an EMCY is sent all the same"
    )


@CHECKS.rule("guarding.toggle", "CiA 301 7.2.8.3.2.1", Level.WRITE)
def guarding(bench: Bench) -> None:
    """A guarded node answers remote frames with its state and a toggle bit that alternates."""
    _need_remote(bench)
    bench.needed(0x100C)
    if bench.optional(0x1017) is not None:
        bench.change(0x1017, 0, 0, 2)
    toggles = []
    for _ in range(4):
        since = len(bench.log)
        bench.send(0x700 + bench.node, b"", remote=True)
        answer = bench.wait(0x700 + bench.node, 0.2, since=since)
        require(answer is not None, "no answer to a guarding request")
        assert answer is not None
        require(answer.data[0] & 0x7F == WAITING, f"it answers 0x{answer.data[0]:02X}")
        toggles.append(answer.data[0] >> 7)
    require(toggles in ([0, 1, 0, 1], [1, 0, 1, 0]), f"toggle bits {toggles}")


@CHECKS.rule("guarding.life", "CiA 301 7.2.8.2.2.2", Level.WRITE)
def life(bench: Bench) -> None:
    """A guarded node whose master falls silent sends EMCY 0x8130 after its life time."""
    _need_remote(bench)
    bench.needed(0x100C)
    if bench.optional(0x1017) is not None:
        bench.change(0x1017, 0, 0, 2)
    bench.change(0x100C, 0, 50, 2)
    bench.change(0x100D, 0, 3, 1)
    for _ in range(4):
        bench.send(0x700 + bench.node, b"", remote=True)
        bench.listen(0.05)
    since = len(bench.log)
    found = _emergency(bench, LOST, 0.5, since)
    bench.send(0x700 + bench.node, b"", remote=True)
    bench.listen(0.02)
    require(found is not None, "no EMCY 0x8130 after the life time")


def _need_remote(bench: Bench) -> None:
    if not bench.port.remote:
        raise NotApplicableError("this interface sends no remote frames")
