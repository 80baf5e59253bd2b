"""Statusword and controlword of CiA 402 drives, and the next step towards what is wanted."""

import enum


class State(enum.Enum):
    """State of a drive, in its profile's words."""

    NOT_READY = "not ready to switch on"
    DISABLED = "switch on disabled"
    READY = "ready to switch on"
    SWITCHED_ON = "switched on"
    ENABLED = "operation enabled"
    QUICK_STOP = "quick stop active"
    REACTING = "fault reaction active"
    FAULT = "fault"


class Want(enum.Enum):
    """What the master wants of its drives."""

    NOTHING = "no commands at all"
    DISABLE = "voltage off"
    ENABLE = "follow targets"
    QUICK_STOP = "stop as fast as allowed"
    RESET = "clear faults"


_MASKED = (
    (0x4F, 0x00, State.NOT_READY), (0x4F, 0x40, State.DISABLED), (0x6F, 0x21, State.READY),
    (0x6F, 0x23, State.SWITCHED_ON), (0x6F, 0x27, State.ENABLED), (0x6F, 0x07, State.QUICK_STOP),
    (0x4F, 0x0F, State.REACTING), (0x4F, 0x08, State.FAULT),
)  # fmt: skip
LIMITED = 1 << 11
"""Statusword: the drive does not go where it is told, an internal limit is active."""
SHUTDOWN, SWITCH_ON, ENABLE, VOLTAGE_OFF, QUICK_STOP, FAULT_RESET = (
    0x06,
    0x07,
    0x0F,
    0x00,
    0x02,
    0x80,
)


def state_of(statusword: int) -> State:
    """The state that a statusword (0x6041) tells; NOT_READY where it tells none."""
    for mask, value, state in _MASKED:
        if statusword & mask == value:
            return state
    return State.NOT_READY


def controlword(want: Want, state: State, last: int) -> int:
    """The controlword (0x6040) that brings a drive one step nearer, after the last one sent.

    A fault is cleared by the rising edge of its bit, so every other word is without it.
    """
    match want:
        case Want.QUICK_STOP:
            return QUICK_STOP
        case Want.RESET:
            stuck = state in (State.FAULT, State.REACTING)
            return FAULT_RESET if stuck and last == VOLTAGE_OFF else VOLTAGE_OFF
        case Want.ENABLE:
            steps = {
                State.DISABLED: SHUTDOWN, State.READY: SWITCH_ON, State.SWITCHED_ON: ENABLE,
                State.ENABLED: ENABLE,
            }  # fmt: skip
            return steps.get(state, VOLTAGE_OFF)
        case _:
            return VOLTAGE_OFF


ERRORS = {
    0x2310: "over-current", 0x3210: "supply too high", 0x3220: "supply too low",
    0x4210: "drive too hot", 0x5441: "emergency input", 0x7300: "encoder", 0x7305: "encoder",
    0x8130: "heartbeat of the master lost", 0x8250: "no targets arrived in time",
    0x8611: "following error", 0x8612: "position limit", 0x8700: "SYNC lost or of wrong period",
}  # fmt: skip
"""Error codes (0x603F, EMCY) of CiA 301 and 402 that are worth words."""


def error_words(code: int) -> str:
    """An error code in words."""
    return f"0x{code:04X}" + (f" ({ERRORS[code]})" if code in ERRORS else "")


def stopped_itself(code: int) -> bool:
    """Whether a code means that the drive stopped because its master fell silent."""
    return code in (0x8130, 0x8250, 0x8700)
