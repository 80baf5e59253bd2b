"""Checks of the state machine of CiA 402: every command in every state, by SDO and by PDO.

Source: CiA 402-2 (IEC 61800-7-201), finite state automaton, its transitions and the coding of
controlword and statusword.
"""

import contextlib
import struct
from collections.abc import Callable

from wrenchbed.hardware.conformity.bench import (
    PRE_OPERATIONAL,
    RUNNING,
    START,
    Bench,
    FailedError,
    NotApplicableError,
    RefusedError,
    require,
)
from wrenchbed.hardware.conformity.checks import Check, Checks, Level
from wrenchbed.hardware.conformity.network import LOST, OTHER
from wrenchbed.hardware.conformity.objects import PP, PV, has_mode
from wrenchbed.hardware.conformity.process_data import CONTROL, map_pdo

CHECKS = Checks()
DISABLED, READY, ON, ENABLED, QUICK, REACTING, FAULT = (
    "switch on disabled", "ready to switch on", "switched on", "operation enabled",
    "quick stop active", "fault reaction active", "fault",
)  # fmt: skip
_MASKS = {
    DISABLED: (0x4F, 0x40), READY: (0x6F, 0x21), ON: (0x6F, 0x23), ENABLED: (0x6F, 0x27),
    QUICK: (0x6F, 0x07), REACTING: (0x4F, 0x0F), FAULT: (0x4F, 0x08),
}  # fmt: skip
"""Mask and value of the statusword in each state."""
VOLTAGE_OFF, QUICK_STOP, SHUTDOWN, SWITCH_ON, ENABLE, RESET = 0x00, 0x02, 0x06, 0x07, 0x0F, 0x80
_SAME = ""
ROWS = {
    DISABLED: {
        VOLTAGE_OFF: _SAME, QUICK_STOP: _SAME, SHUTDOWN: READY, SWITCH_ON: _SAME, ENABLE: _SAME,
    },
    READY: {
        VOLTAGE_OFF: DISABLED, QUICK_STOP: DISABLED, SHUTDOWN: _SAME, SWITCH_ON: ON,
        ENABLE: ENABLED,
    },
    ON: {
        VOLTAGE_OFF: DISABLED, QUICK_STOP: DISABLED, SHUTDOWN: READY, SWITCH_ON: _SAME,
        ENABLE: ENABLED,
    },
    ENABLED: {
        VOLTAGE_OFF: DISABLED, QUICK_STOP: QUICK, SHUTDOWN: READY, SWITCH_ON: ON, ENABLE: _SAME,
    },
    QUICK: {
        VOLTAGE_OFF: DISABLED, QUICK_STOP: _SAME, SHUTDOWN: _SAME, SWITCH_ON: _SAME,
        ENABLE: ENABLED,
    },
    FAULT: {
        VOLTAGE_OFF: _SAME, QUICK_STOP: _SAME, SHUTDOWN: _SAME, SWITCH_ON: _SAME, ENABLE: _SAME,
        RESET: DISABLED,
    },
}  # fmt: skip
"""State and controlword → the state after it; empty where the command is ignored."""
_WAY = {
    DISABLED: (), READY: (SHUTDOWN,), ON: (SHUTDOWN, SWITCH_ON),
    ENABLED: (SHUTDOWN, SWITCH_ON, ENABLE), QUICK: (SHUTDOWN, SWITCH_ON, ENABLE, QUICK_STOP),
}  # fmt: skip
_REACHED_S, _STAYS_S = 2.0, 0.15
"""Deadline of a transition; how long a state must last that should not change [s]; estimates."""
_STAY_OPTION, _SHORTEST_STAY = 6, 5
_SILENCE_MS = 150


def status(bench: Bench) -> int:
    """The statusword."""
    return bench.read(0x6041)


def state_of(word: int) -> str:
    """The state of a statusword; its number where it is none."""
    for state, (mask, value) in _MASKS.items():
        if word & mask == value:
            return state
    return f"unknown (statusword 0x{word:04X})"


def until(bench: Bench, wanted: str, seconds: float = _REACHED_S) -> str:
    """The state once it is the wanted one, or at the deadline [s]."""
    end = bench.port.now() + seconds
    while True:
        state = state_of(status(bench))
        if state == wanted or bench.port.now() >= end:
            return state
        bench.listen(0.01)


def control(bench: Bench, word: int) -> None:
    """Write the controlword."""
    bench.write(0x6040, 0, word, 2)


def off(bench: Bench) -> None:
    """Bring the drive to SWITCH ON DISABLED from wherever it is.

    Raises:
        FailedError: it does not go there.
    """
    control(bench, VOLTAGE_OFF)
    state = until(bench, DISABLED, 0.3)
    if state in (FAULT, REACTING):
        bench.send(0x700 + OTHER, bytes([RUNNING]))
        until(bench, FAULT)
        control(bench, RESET)
        control(bench, VOLTAGE_OFF)
    state = until(bench, DISABLED)
    require(state == DISABLED, f"it does not reach SWITCH ON DISABLED but is in: {state}")


def prepare(bench: Bench) -> None:
    """A mode that stands still without a command, and a quick stop that stays."""
    for mode in (PP, PV):
        if has_mode(bench, mode):
            bench.change(0x6060, 0, mode, 1)
            break
    if bench.optional(0x60FF) is not None:
        bench.change(0x60FF, 0, 0, 4)
    with contextlib.suppress(RefusedError):
        bench.change(0x605A, 0, _STAY_OPTION, 2)


def reach(bench: Bench, state: str) -> None:
    """Bring the drive to a state by the way that the standard names.

    Raises:
        FailedError: it does not go there.
    """
    if state == FAULT:
        into_fault(bench)
        return
    off(bench)
    for word in _WAY[state]:
        control(bench, word)
        bench.listen(0.02)
    got = until(bench, state)
    if state == QUICK and got == DISABLED and _option(bench) < _SHORTEST_STAY:
        raise NotApplicableError("the drive leaves QUICK STOP ACTIVE by itself")
    require(got == state, f"it does not reach {state}, but {got}")


def _option(bench: Bench) -> int:
    return bench.optional(0x605A, signed=True) or 2


def into_fault(bench: Bench) -> None:
    """Bring the drive to FAULT: enabled, it loses a heartbeat that it expects.

    Raises:
        NotApplicableError: it has no 0x1016 or no 0x6007.
        FailedError: it does not go there.
    """
    expect_heartbeat(bench, 1)
    reach(bench, ENABLED)
    lose_heartbeat(bench)
    got = until(bench, FAULT)
    require(got == FAULT, f"a lost heartbeat with 0x6007 = 1 leads to {got}")


def expect_heartbeat(bench: Bench, option: int) -> None:
    """Make the drive expect a heartbeat, and react to its loss as 0x6007 says."""
    bench.needed(0x1016, 1)
    bench.needed(0x6007)
    try:
        bench.change(0x6007, 0, option, 2)
    except RefusedError as error:
        raise NotApplicableError(f"0x6007 does not take {option}") from error
    if bench.optional(0x1029, 1) is not None:
        bench.change(0x1029, 1, 1, 1)
    bench.change(0x1016, 1, OTHER << 16 | 0, 4)


def lose_heartbeat(bench: Bench) -> None:
    """Send one heartbeat, and no more."""
    bench.write(0x1016, 1, OTHER << 16 | _SILENCE_MS, 4)
    bench.send(0x700 + OTHER, bytes([RUNNING]))
    bench.listen(_SILENCE_MS * 2.0 / 1000.0)
    bench.write(0x1016, 1, 0, 4)


def by_pdo(bench: Bench) -> Callable[[int], None]:
    """What sends a controlword by an RPDO that acts when it comes."""
    if bench.optional(0x1400, 1) is None:
        raise NotApplicableError("the drive has no RPDO")
    used = map_pdo(bench, 0x1400, (CONTROL,), 255)
    if bench.optional(0x1400, 5):
        bench.change(0x1400, 5, 0, 2)
    bench.nmt(START)
    return lambda word: bench.send(used, struct.pack("<H", word))


def _row(state: str, word: int, after: str, pdo: bool) -> Callable[[Bench], None]:
    def run(bench: Bench) -> None:
        prepare(bench)
        act: Callable[[int], None] = by_pdo(bench) if pdo else lambda w: control(bench, w)
        reach(bench, state)
        act(word)
        expected = after or state
        if expected == QUICK and _option(bench) < _SHORTEST_STAY:
            expected = DISABLED
        if after:
            got = until(bench, expected)
        else:
            bench.listen(_STAYS_S)
            got = state_of(status(bench))
        require(got == expected, f"0x{word:02X} in {state} leads to {got}, not {expected}")

    return run


def _transitions() -> None:
    for state, words in ROWS.items():
        for word, after in words.items():
            for pdo in (False, True):
                harmless = state in (DISABLED, READY) and word <= SHUTDOWN
                what = f"leads to {after.upper()}" if after else "is ignored"
                CHECKS.append(
                    Check(
                        f"state.{state.replace(' ', '-')}.{word:02X}.{'pdo' if pdo else 'sdo'}",
                        "CiA 402-2 finite state automaton",
                        f"0x{word:02X} in {state.upper()} {what}, by {'PDO' if pdo else 'SDO'}.",
                        Level.WRITE if harmless else Level.MOVE, _row(state, word, after, pdo),
                    )
                )  # fmt: skip


@CHECKS.rule("state.known", "CiA 402-2 0x6041", Level.READ)
def known(bench: Bench) -> None:
    """The statusword shows one of the states."""
    word = status(bench)
    require(
        word & 0x4F == 0 or not state_of(word).startswith("unknown"), state_of(word)
    )  # fmt: skip


_transitions()


@CHECKS.rule("state.bits", "CiA 402-2 0x6041", Level.MOVE)
def bits(bench: Bench) -> None:
    """OPERATION ENABLED shows voltage (bit 4) and remote (bit 9), and no warning of a fault."""
    prepare(bench)
    reach(bench, ENABLED)
    word = status(bench)
    require(bool(word & 1 << 4), "bit 4 (voltage enabled) is 0 in OPERATION ENABLED")
    require(bool(word & 1 << 9), "bit 9 (remote) is 0 although the drive takes controlwords")
    require(not word & 1 << 3, "bit 3 (fault) is set")


@CHECKS.rule("fault.shown", "CiA 402-2 0x603F, CiA 301 7.2.7", Level.MOVE)
def fault_shown(bench: Bench) -> None:
    """FAULT comes with an EMCY, its code in 0x603F and a bit in the error register."""
    prepare(bench)
    since = len(bench.log)
    into_fault(bench)
    told = [f.data for f in bench.log[since:] if f.can_id == 0x80 + bench.node]
    codes = [int.from_bytes(data[:2], "little") for data in told]
    require(LOST in codes, f"no EMCY 0x{LOST:04X} for the lost heartbeat")
    code = bench.optional(0x603F)
    require(code != 0, "0x603F is 0 in FAULT")
    require(code is None or code in codes, f"0x603F is 0x{code or 0:04X}, told was another code")
    require(bool(bench.read(0x1001) & 1), "the error register is 0 in FAULT")


@CHECKS.rule("fault.edge", "CiA 402-2 transition 15", Level.MOVE)
def fault_edge(bench: Bench) -> None:
    """A fault is reset by the rising edge of bit 7, not while it stays set."""
    prepare(bench)
    expect_heartbeat(bench, 1)
    reach(bench, ENABLED)
    control(bench, RESET | ENABLE)
    if until(bench, ENABLED, 0.1) != ENABLED:
        raise NotApplicableError("the drive leaves OPERATION ENABLED at 0x8F")
    lose_heartbeat(bench)
    bench.send(0x700 + OTHER, bytes([RUNNING]))
    require(until(bench, FAULT) == FAULT, "a lost heartbeat with 0x6007 = 1 is no fault")
    control(bench, RESET | ENABLE)
    bench.listen(_STAYS_S)
    got = state_of(status(bench))
    require(got == FAULT, f"bit 7 that was set before leads from FAULT to {got}")
    control(bench, VOLTAGE_OFF)
    control(bench, RESET)
    got = until(bench, DISABLED)
    require(got == DISABLED, f"the rising edge of bit 7 leads from FAULT to {got}")


@CHECKS.rule("fault.cleared", "CiA 402-2 transition 15, 0x603F", Level.MOVE)
def fault_cleared(bench: Bench) -> None:
    """After a reset the error register is 0 again and EMCY 0x0000 was sent."""
    prepare(bench)
    into_fault(bench)
    bench.send(0x700 + OTHER, bytes([RUNNING]))
    since = len(bench.log)
    control(bench, VOLTAGE_OFF)
    control(bench, RESET)
    require(until(bench, DISABLED) == DISABLED, "the fault is not reset")
    bench.listen(0.05)
    told = [f.data[:2] for f in bench.log[since:] if f.can_id == 0x80 + bench.node]
    require(b"\0\0" in told, "no EMCY 0x0000 after the reset")
    register = bench.read(0x1001)
    require(register == 0, f"the error register is 0x{register:02X} after the reset")


def _connection(option: int, expected: str) -> Callable[[Bench], None]:
    def run(bench: Bench) -> None:
        prepare(bench)
        expect_heartbeat(bench, option)
        reach(bench, ENABLED)
        lose_heartbeat(bench)
        got = until(bench, expected, 0.5)
        if expected == QUICK and got == DISABLED and _option(bench) < _SHORTEST_STAY:
            return
        require(got == expected, f"a lost heartbeat with 0x6007 = {option} leads to {got}")

    return run


for _option_code, _expected in ((0, ENABLED), (1, FAULT), (2, DISABLED), (3, QUICK)):
    CHECKS.append(
        Check(
            f"connection.{_option_code}", "CiA 402-2 0x6007",
            f"A lost heartbeat with option {_option_code} leads to {_expected.upper()}.",
            Level.MOVE, _connection(_option_code, _expected),
        )
    )  # fmt: skip


def leave(bench: Bench) -> None:
    """Voltage off and PRE-OPERATIONAL, whatever a check left."""
    bench.send(0x700 + OTHER, bytes([RUNNING]))
    bench.nmt(PRE_OPERATIONAL)
    with contextlib.suppress(FailedError, RefusedError):
        off(bench)
