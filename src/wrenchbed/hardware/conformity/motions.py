"""Checks of the modes of operation, with motions of at most the distance that the user allows."""

import struct
from collections.abc import Callable

from wrenchbed.hardware.conformity.bench import (
    START,
    Bench,
    FailedError,
    NotApplicableError,
    RefusedError,
    require,
)
from wrenchbed.hardware.conformity.checks import Checks, Level
from wrenchbed.hardware.conformity.objects import CSP, HM, PP, PV, has_mode, need_mode
from wrenchbed.hardware.conformity.process_data import ACTUAL, CONTROL, STATUS, map_pdo
from wrenchbed.hardware.conformity.states import (
    ENABLE,
    ENABLED,
    FAULT,
    ON,
    QUICK,
    QUICK_STOP,
    REACTING,
    SWITCH_ON,
    control,
    expect_heartbeat,
    lose_heartbeat,
    off,
    prepare,
    reach,
    state_of,
    status,
    until,
)

CHECKS = Checks()
_PP, _PV, _HM, _CSP = (
    "CiA 402-2 profile position mode", "CiA 402-2 profile velocity mode",
    "CiA 402-2 homing mode", "CiA 402-2 cyclic synchronous position mode",
)  # fmt: skip
_NEW, _AT_ONCE, _RELATIVE, _HALT = 1 << 4, 1 << 5, 1 << 6, 1 << 8
_REACHED, _BIT12, _BIT13 = 1 << 10, 1 << 12, 1 << 13
_SLACK = 0.05
"""How far a position may be off, as a share of the distance; an estimate."""
_MORE_S = 4.0
"""How much longer than its distance at its speed a move may take [s]; an estimate."""
_RAMP = 8.0
"""Accelerations reach the speed in this part of a second; an estimate."""
_TARGET = 0x607A0020
_FARTHEST = 1.2
"""Times the distance from where it began at which the axis is stopped; an estimate."""
_TURN_S = 1.5
"""In profile velocity mode the axis would take so long for its distance [s]."""


def _begin(bench: Bench, mode: int) -> int:
    """Enable the drive in a mode; where it is [count].

    Raises:
        NotApplicableError: it may not move, or has no such mode.
    """
    if not bench.settings.distance:
        raise NotApplicableError("no distance was allowed")
    need_mode(bench, mode)
    prepare(bench)
    bench.change(0x6060, 0, mode, 1)
    pace = bench.settings.pace
    for index, value in ((0x6081, pace), (0x6083, _RAMP * pace), (0x6084, _RAMP * pace)):
        if bench.optional(index) is not None:
            bench.change(index, 0, round(value), 4)
    at = bench.read(0x6064, signed=True)
    bench.origin = at if bench.origin is None else bench.origin
    reach(bench, ENABLED)
    return at


def _position(bench: Bench) -> int:
    """Where the axis is [count]; one that left its distance gets a quick stop.

    Raises:
        FailedError: it did.
    """
    position = bench.read(0x6064, signed=True)
    if bench.origin is not None:
        away = abs(position - bench.origin)
        if away > _FARTHEST * bench.settings.distance:
            control(bench, QUICK_STOP)
            raise FailedError(f"it is {away} counts from where it began: stopped")
    return position


def go_back(bench: Bench) -> str:
    """Bring the axis to where it was before the first motion; why not, empty where it is there."""
    if bench.origin is None:
        return ""
    slack = max(3.0, _SLACK * bench.settings.distance)
    try:
        if abs(bench.read(0x6064, signed=True) - bench.origin) <= slack:
            return ""
        off(bench)
        if has_mode(bench, PP):
            _begin(bench, PP)
            _give(bench, bench.origin)
            _arrives(bench, bench.origin)
        else:
            _creep_back(bench, slack)
    except (FailedError, RefusedError, NotApplicableError) as error:
        return f"it could not be brought back to {bench.origin}: {error}"
    return ""


def _creep_back(bench: Bench, slack: float) -> None:
    """Go to the origin in profile velocity mode."""
    origin = bench.origin or 0
    _begin(bench, PV)
    way = origin - bench.read(0x6064, signed=True)
    speed = max(1, round(slack))
    bench.write(0x60FF, 0, speed if way > 0 else -speed, 4)
    end = bench.port.now() + 2.0 * abs(way) / speed + _MORE_S
    while (origin - bench.read(0x6064, signed=True)) * way > 0 and bench.port.now() < end:
        bench.listen(0.01)
    bench.write(0x60FF, 0, 0, 4)
    bench.listen(0.3)


def _speed(bench: Bench) -> int:
    value = bench.optional(0x606C, signed=True)
    if value is None:
        raise NotApplicableError("the drive has no 0x606C")
    return value


def _bits(bench: Bench, mask: int, value: int, seconds: float) -> bool:
    """Whether bits of the statusword become something within some time [s]."""
    end = bench.port.now() + seconds
    while True:
        if status(bench) & mask == value:
            return True
        if bench.settings.distance:
            _position(bench)
        if bench.port.now() >= end:
            return False
        bench.listen(0.005)


def _give(bench: Bench, target: int, more: int = 0) -> None:
    """Hand a set-point over, with its handshake."""
    bench.write(0x607A, 0, target, 4)
    control(bench, ENABLE | more | _NEW)
    require(
        _bits(bench, _BIT12, _BIT12, 0.5), "bit 12 (set-point acknowledge) does not follow bit 4"
    )
    control(bench, ENABLE | more)


def _arrives(bench: Bench, target: int) -> None:
    """The target must be reached, and the position be there."""
    seconds = 2.0 * bench.settings.distance / bench.settings.pace + _MORE_S
    require(_bits(bench, _REACHED, _REACHED, seconds), "bit 10 (target reached) does not come")
    got, slack = _position(bench), max(2.0, _SLACK * bench.settings.distance)
    require(abs(got - target) <= slack, f"bit 10 is set at {got}, the target is {target}")


@CHECKS.rule("pp.absolute", _PP, Level.MOVE)
def pp_absolute(bench: Bench) -> None:
    """A set-point is acknowledged by bit 12, bit 10 goes away, and comes back at the target."""
    at = _begin(bench, PP)
    target = at + bench.settings.distance
    _give(bench, target)
    require(not status(bench) & _REACHED, "bit 10 stays set although a new target is far")
    require(_bits(bench, _BIT12, 0, 0.5), "bit 12 stays set although bit 4 is 0")
    _arrives(bench, target)
    _give(bench, at)
    _arrives(bench, at)


@CHECKS.rule("pp.edge", _PP, Level.MOVE)
def pp_edge(bench: Bench) -> None:
    """A target without a rising edge of bit 4 moves nothing."""
    at = _begin(bench, PP)
    bench.write(0x607A, 0, at + bench.settings.distance, 4)
    control(bench, ENABLE)
    bench.listen(0.3)
    moved = abs(_position(bench) - at)
    require(moved <= _SLACK * bench.settings.distance + 2, f"it moved by {moved} without bit 4")


@CHECKS.rule("pp.relative", _PP, Level.MOVE)
def pp_relative(bench: Bench) -> None:
    """With bit 6 the target is a way from the last target."""
    at, half = _begin(bench, PP), bench.settings.distance // 2
    _give(bench, at)
    _arrives(bench, at)
    for k in (1, 2):
        _give(bench, half, _RELATIVE)
        _arrives(bench, at + k * half)
    _give(bench, at)
    _arrives(bench, at)


@CHECKS.rule("pp.buffered", _PP, Level.MOVE)
def pp_buffered(bench: Bench) -> None:
    """A second set-point waits until the first one is reached; bit 12 stays while none fits."""
    at, d = _begin(bench, PP), bench.settings.distance
    _give(bench, at + d)
    if not _bits(bench, _BIT12, 0, 0.2):
        raise NotApplicableError("the drive keeps no second set-point")
    _give(bench, at)
    bench.listen(0.05)
    require(bool(status(bench) & _BIT12), "bit 12 is 0 although no third set-point fits")
    farthest = _farthest(bench, at, 1.2 * d / bench.settings.pace + 0.5)
    require(farthest > 0.9 * d, f"it went {farthest} of {d}: the second set-point did not wait")
    _arrives(bench, at)


def _farthest(bench: Bench, at: int, seconds: float) -> int:
    """The largest way from a position within some time [s]."""
    end, most = bench.port.now() + seconds, 0
    while bench.port.now() < end:
        most = max(most, abs(_position(bench) - at))
        bench.listen(0.005)
    return most


@CHECKS.rule("pp.at-once", _PP, Level.MOVE)
def pp_at_once(bench: Bench) -> None:
    """With bit 5 a new set-point replaces the one before at once."""
    at, d = _begin(bench, PP), bench.settings.distance
    _give(bench, at + d)
    bench.listen(0.3 * d / bench.settings.pace)
    _give(bench, at, _AT_ONCE)
    farthest = _farthest(bench, at, d / bench.settings.pace)
    require(farthest < 0.9 * d, f"it went {farthest} of {d}: the new set-point waited")
    _arrives(bench, at)


@CHECKS.rule("pp.halt", _PP, Level.MOVE)
def pp_halt(bench: Bench) -> None:
    """Bit 8 stops the axis, bit 10 tells that it stands; without bit 8 it goes on."""
    at, d = _begin(bench, PP), bench.settings.distance
    _give(bench, at + d)
    bench.listen(0.3 * d / bench.settings.pace)
    control(bench, ENABLE | _HALT)
    bench.listen(0.4)
    one = _position(bench)
    bench.listen(0.1)
    two = _position(bench)
    require(abs(one - two) <= 0.01 * d + 1, "it moves although bit 8 (halt) is set")
    require(abs(two - at) < 0.9 * d, "bit 8 (halt) does not stop it")
    require(bool(status(bench) & _REACHED), "bit 10 is 0 although it stands by halt")
    control(bench, ENABLE)
    _arrives(bench, at + d)
    _give(bench, at)
    _arrives(bench, at)


@CHECKS.rule("pp.speed", _PP, Level.MOVE)
def pp_speed(bench: Bench) -> None:
    """A move keeps to the profile velocity (0x6081)."""
    at, pace = _begin(bench, PP), bench.settings.pace
    wanted = pace // 2
    bench.write(0x6081, 0, wanted, 4)
    _give(bench, at + bench.settings.distance)
    bench.listen(0.3 * bench.settings.distance / wanted)
    begin, first = bench.port.now(), _position(bench)
    bench.listen(0.3 * bench.settings.distance / wanted)
    seconds, way = bench.port.now() - begin, _position(bench) - first
    mean = way / seconds
    bench.write(0x6081, 0, pace, 4)
    require(0.8 < mean / wanted < 1.2, f"it moves with {mean:.0f} count/s, 0x6081 is {wanted}")
    _arrives(bench, at + bench.settings.distance)
    _give(bench, at)
    _arrives(bench, at)


@CHECKS.rule("pv.speed", _PV, Level.MOVE)
def pv_speed(bench: Bench) -> None:
    """The axis takes the target velocity; bit 10 tells that, bit 12 that it stands."""
    _begin(bench, PV)
    pace = _turning(bench)
    require(_bits(bench, _BIT12, _BIT12, 0.5), "bit 12 (speed is 0) is not set at rest")
    for target in (pace, -pace):
        bench.write(0x60FF, 0, target, 4)
        require(
            _bits(bench, _REACHED, _REACHED, 1.0), "bit 10 does not come at the target velocity"
        )
        bench.listen(0.15)
        speed = _speed(bench)
        require(abs(speed - target) < 0.15 * pace, f"0x606C is {speed}, 0x60FF {target}")
        require(not status(bench) & _BIT12, "bit 12 (speed is 0) is set while it moves")
        begin, first = bench.port.now(), _position(bench)
        bench.listen(0.2)
        mean = (_position(bench) - first) / (bench.port.now() - begin)
        require(abs(mean - target) < 0.25 * pace, f"the position moves by {mean:.0f} count/s")
    bench.write(0x60FF, 0, 0, 4)
    require(_bits(bench, _BIT12, _BIT12, 1.0), "bit 12 (speed is 0) does not come at rest")


@CHECKS.rule("pv.halt", _PV, Level.MOVE)
def pv_halt(bench: Bench) -> None:
    """Bit 8 stops the axis although a target velocity is set."""
    _run_at_speed(bench)
    control(bench, ENABLE | _HALT)
    bench.listen(0.4)
    _stands(bench, "bit 8 (halt)")
    bench.write(0x60FF, 0, 0, 4)


def _turning(bench: Bench) -> int:
    """Speed of profile velocity mode, at which the axis stays within its distance [count/s]."""
    return max(1, min(bench.settings.pace // 2, round(bench.settings.distance / _TURN_S)))


def _run_at_speed(bench: Bench) -> None:
    """Move in profile velocity mode."""
    _begin(bench, PV)
    bench.write(0x60FF, 0, _turning(bench), 4)
    bench.listen(0.3)
    require(_speed(bench) != 0, "it does not move at its target velocity")


def _stands(bench: Bench, why: str) -> None:
    one = _position(bench)
    bench.listen(0.1)
    moved = abs(_position(bench) - one)
    require(moved <= 0.01 * bench.settings.distance + 1, f"it still moves after {why}")


@CHECKS.rule("stop.quick", "CiA 402-2 transition 11, 0x605A", Level.MOVE)
def quick_stop(bench: Bench) -> None:
    """A quick stop ends a motion."""
    _run_at_speed(bench)
    control(bench, QUICK_STOP)
    bench.listen(0.4)
    got = state_of(status(bench))
    option = bench.optional(0x605A, signed=True)
    require(got == QUICK or (option or 2) < 5, f"a quick stop leads to {got}")
    _stands(bench, "a quick stop")
    bench.write(0x60FF, 0, 0, 4)


@CHECKS.rule("stop.disable", "CiA 402-2 transition 5, 0x605C", Level.MOVE)
def disable(bench: Bench) -> None:
    """DISABLE OPERATION ends a motion."""
    _run_at_speed(bench)
    control(bench, SWITCH_ON)
    got = until(bench, ON)
    require(got == ON, f"0x07 while it moves leads to {got}")
    bench.listen(0.3)
    _stands(bench, "DISABLE OPERATION")
    bench.write(0x60FF, 0, 0, 4)


@CHECKS.rule("stop.fault", "CiA 402-2 transitions 13 and 14, 0x605E", Level.MOVE)
def fault(bench: Bench) -> None:
    """A fault ends a motion, by FAULT REACTION ACTIVE if at all."""
    expect_heartbeat(bench, 1)
    _run_at_speed(bench)
    lose_heartbeat(bench)
    state = state_of(status(bench))
    require(state in (FAULT, REACTING), f"a lost heartbeat leads to {state}")
    got = until(bench, FAULT)
    require(got == FAULT, f"FAULT REACTION ACTIVE leads to {got}")
    _stands(bench, "a fault")


@CHECKS.rule("hm.unknown", "CiA 402-2 0x6098", Level.WRITE)
def hm_unknown(bench: Bench) -> None:
    """A homing method that does not exist is refused."""
    need_mode(bench, HM)
    bench.refusal(
        lambda: bench.write(0x6098, 0, 40, 1), (0x06090030, 0x06090031, 0x06090032),
        "homing method 40",
    )  # fmt: skip


@CHECKS.rule("hm.here", _HM, Level.MOVE)
def hm_here(bench: Bench) -> None:
    """Homing method 37 or 35 makes the present position the home offset; bits 12 and 10 tell it."""
    at = _begin(bench, HM)
    for method in (37, 35):
        try:
            bench.change(0x6098, 0, method, 1)
            break
        except RefusedError:
            continue
    else:
        raise NotApplicableError("the drive has neither method 37 nor 35")
    bench.needed(0x607C)
    if bench.optional(0x607E) is not None:
        require(bench.read(0x607E) & 0x80 == 0, "0x607E turns positions round: not tested")
    offset = at + bench.settings.distance // 2 + 1
    bench.change(0x607C, 0, offset, 4)
    got = _home(bench, offset)
    now = bench.read(0x6064, signed=True)
    bench.write(0x607C, 0, at + now - got, 4)
    _home(bench, at)
    slack = max(3.0, _SLACK * bench.settings.distance)
    require(abs(got - offset) <= slack, f"the position is {got} after homing, 0x607C {offset}")


def _home(bench: Bench, offset: int) -> int:
    control(bench, ENABLE)
    control(bench, ENABLE | _NEW)
    done = _bits(bench, _BIT12 | _REACHED | _BIT13, _BIT12 | _REACHED, 2.0)
    word, got = status(bench), _position(bench)
    control(bench, ENABLE)
    require(done, f"homing to {offset} ends with statusword 0x{word:04X}, not with bits 10 and 12")
    return got


@CHECKS.rule("csp.follows", _CSP, Level.MOVE)
def csp_follows(bench: Bench) -> None:
    """Targets of every SYNC are followed, and bit 12 tells that they are."""
    require_distance = bench.settings.distance
    need_mode(bench, CSP)
    if not require_distance:
        raise NotApplicableError("no distance was allowed")
    prepare(bench)
    bench.change(0x6060, 0, CSP, 1)
    period = round(bench.settings.sync_s * 1000.0)
    if bench.optional(0x60C2, 1) is not None:
        bench.change(0x60C2, 1, period, 1)
        bench.change(0x60C2, 2, -3, 1)
    got, used = _exchange(bench)
    at = got()[1]
    for word in (0x06, 0x07, ENABLE):
        for _ in range(10):
            _cycle(bench, used, word, at)
    word, at = got()
    require(state_of(word) == ENABLED, f"in mode 8 it does not reach {ENABLED}: {state_of(word)}")
    require(bool(word & _BIT12), "bit 12 (follows the targets) is 0 in OPERATION ENABLED")
    cycles = max(20, round(bench.settings.distance / bench.settings.pace / bench.settings.sync_s))
    ways = [bench.settings.distance * min(k, 2 * cycles - k) // cycles for k in range(2 * cycles)]
    most = 0
    for way in ways:
        _cycle(bench, used, ENABLE, at + way)
        most = max(most, got()[1] - at)
    for _ in range(30):
        _cycle(bench, used, ENABLE, at)
    word, end = got()
    slack = max(3.0, _SLACK * bench.settings.distance)
    require(state_of(word) == ENABLED, f"while it followed it went to {state_of(word)}")
    require(most > 0.6 * bench.settings.distance, f"it went {most} of {bench.settings.distance}")
    require(abs(end - at) <= slack, f"it ends at {end}, the last target is {at}")


def _exchange(bench: Bench) -> tuple[Callable[[], tuple[int, int]], int]:
    """Map the cyclic exchange and start it: what reads the last answer, and the RPDO's id."""
    used = map_pdo(bench, 0x1400, (CONTROL, _TARGET), 1)
    sent = map_pdo(bench, 0x1800, (STATUS, ACTUAL), 1)
    bench.nmt(START)
    bench.sync()
    bench.listen(0.05)

    def last() -> tuple[int, int]:
        came = [f.data for f in reversed(bench.log) if f.can_id == sent]
        require(bool(came), "no TPDO came at SYNC")
        word, position = struct.unpack("<Hi", came[0][:6])
        return word, position

    return last, used


def _cycle(bench: Bench, used: int, word: int, target: int) -> None:
    bench.send(used, struct.pack("<Hi", word, target))
    bench.sync()
    bench.listen(bench.settings.sync_s)
