"""CiA 402: statusword, controlword, error codes, and the state of one drive as its master knows it.
Source of all codes: CiA 301 and CiA 402 (robot_emulators/medrue is written anew from them)."""

import enum
import struct
from dataclasses import dataclass

from wrenchbed.hardware.device_base import State as HealthState

Problem = tuple[HealthState, str]
"""State of health, and the reason in words."""
MISSED = 2
"""Cycles without an answer, while others answer, after which a drive is mute: one may be lost."""
BEATS = 18
"""Heartbeats of the five others (3.5 periods) without its own after which a drive is lost."""
OPERATIONAL, PRE_OPERATIONAL = 0x05, 0x7F
"""NMT states (CiA 301); drives enter the second when the master's heartbeat is lost (0x1029)."""
SHUTDOWN, SWITCH_ON, ENABLE, VOLTAGE_OFF, QUICK_STOP, FAULT_RESET = 6, 7, 0x0F, 0, 2, 0x80
"""Controlwords (0x6040); source: CiA 402."""
ERRORS = {
    0x2310: "over-current",
    0x3210: "supply too high",
    0x3220: "supply too low",
    0x4210: "drive too hot",
    0x5441: "emergency input",
    0x7300: "encoder",
    0x7305: "encoder",
    0x8130: "heartbeat of the master lost",
    0x8250: "no targets arrived in time",
    0x8611: "following error",
    0x8612: "position limit",
    0x8700: "SYNC lost or of wrong period",
}
"""Error code (0x603F, EMCY) of CiA 301 and 402 → its meaning."""
SILENCE = (0x8130, 0x8250, 0x8700)
"""Error codes of drives that stopped as their master was silent; `recover` needs no ``unlock``."""


class DriveStatus(enum.Enum):
    """State of a servo drive by CiA 402, CANopen's profile of drives; values are its names."""

    NOT_READY = "not ready to switch on"
    DISABLED = "switch on disabled"
    READY = "ready to switch on"
    SWITCHED_ON = "switched on"
    ENABLED = "operation enabled"
    QUICK_STOP = "quick stop active"
    REACTING = "fault reaction active"
    FAULT = "fault"


class Want(enum.Enum):
    """State that this program, the CAN master, wants its drives in, or its command to them."""

    NOTHING = "no commands at all"
    DISABLE = "voltage off"
    ENABLE = "follow targets"
    QUICK_STOP = "stop as fast as allowed"
    RESET = "clear faults"


_MASKED = (
    (0x4F, 0x00, DriveStatus.NOT_READY),
    (0x4F, 0x40, DriveStatus.DISABLED),
    (0x6F, 0x21, DriveStatus.READY),
    (0x6F, 0x23, DriveStatus.SWITCHED_ON),
    (0x6F, 0x27, DriveStatus.ENABLED),
    (0x6F, 0x07, DriveStatus.QUICK_STOP),
    (0x4F, 0x0F, DriveStatus.REACTING),
    (0x4F, 0x08, DriveStatus.FAULT),
)
"""Mask of the statusword, its value under the mask, and the state; source: CiA 402."""


IN_FAULT = (DriveStatus.FAULT, DriveStatus.REACTING)
_CLIMB = {
    DriveStatus.DISABLED: SHUTDOWN,
    DriveStatus.READY: SWITCH_ON,
    DriveStatus.SWITCHED_ON: ENABLE,
    DriveStatus.ENABLED: ENABLE,
}
"""State of a drive → controlword for the next step towards "operation enabled"."""


def state_of(statusword: int) -> DriveStatus:
    """Decode a drive's state from its statusword (0x6041); NOT_READY if no state matches."""
    for mask, value, state in _MASKED:
        if statusword & mask == value:
            return state
    return DriveStatus.NOT_READY


def controlword(want: Want, state: DriveStatus, last: int) -> int:
    """Return the controlword (object 0x6040) that takes a drive a step from ``state`` towards
    ``want``; ``last`` is the one sent before. The rising edge of a bit resets a fault, so other
    words leave it 0."""
    if want is Want.QUICK_STOP:
        return QUICK_STOP
    if want is Want.RESET and state in IN_FAULT and last == VOLTAGE_OFF:
        return FAULT_RESET
    return _CLIMB.get(state, VOLTAGE_OFF) if want is Want.ENABLE else VOLTAGE_OFF


def error_words(code: int) -> str:
    """Describe a CANopen error code in words."""
    return f"0x{code:04X}" + (f" ({ERRORS[code]})" if code in ERRORS else "")


@dataclass
class DriveState:
    """State of one CANopen drive as the master knows it from its messages.

    Attributes:
        node: CANopen node id.
        statusword: object 0x6041 in its last answer.
        position: object 0x6064 in its last answer [count].
        torque: object 0x6077 [1e-3 of the rated torque] in its last answer; or 0x6078, current.
        answers, answered: number of answers so far, and whether one came in this cycle.
        missed: consecutive rounds in which other drives answered and this one did not.
        round: number of the last round that it answered.
        error, hint: code of its last emergency message, of one before `connect` (0x603F); 0: none.
        rebooted: whether it sent a boot-up message since it was configured.
        others: heartbeats of other drives since its own last one; a silent bus does not count.
        nmt: state of network management (NMT) in its last heartbeat.
        sent: the last controlword sent to it.
    """

    node: int
    statusword: int = 0
    position: int = 0
    torque: int = 0
    answers: int = 0
    answered: bool = False
    missed: int = 0
    round: int = 0
    error: int = 0
    rebooted: bool = False
    others: int = 0
    nmt: int = OPERATIONAL
    sent: int = 0
    hint: int = 0

    @property
    def state(self) -> DriveStatus:
        """CiA 402 state decoded from the last statusword."""
        return state_of(self.statusword)

    def take_answer(self, data: bytes) -> bool:
        """Store data of the drive's cyclic answer (TPDO); return False if its length is wrong."""
        if len(data) not in (6, 8):
            return False
        self.statusword, self.position = struct.unpack_from("<Hi", data)
        if len(data) == 8:
            (self.torque,) = struct.unpack_from("<h", data, 6)
        self.answers += 1
        self.answered = True
        return True

    def take_emergency(self, data: bytes) -> None:
        """Store the error code of the drive's CANopen emergency message."""
        if len(data) == 8:
            (self.error,) = struct.unpack_from("<H", data)

    def take_heartbeat(self, data: bytes) -> None:
        """Store the network state (NMT) in the drive's heartbeat or boot-up message."""
        if len(data) == 1:
            self.others = 0
            self.nmt = data[0] & 0x7F
            self.rebooted = self.rebooted or self.nmt == 0x00

    def trouble(self, enabled: bool) -> Problem | None:
        """Health state and reason why this drive must not move; None if it may. A drive that is
        gone is ``lost``. One that stopped because its master was silent, or is not in "operation
        enabled" although ``enabled`` says that it should be, is ``stopped``."""
        name = f"drive {self.node}"
        if self.error and self.error not in SILENCE:
            error = error_words(self.error)
            return "fault", f"{name} reports error {error}: call recover(unlock=True)"
        if self.state in IN_FAULT:
            words = f" {error_words(self.hint)}" if self.hint else ""
            return "fault", f"{name} is in fault{words}: call recover(unlock=True)"
        if self.rebooted:
            return "lost", f"{name} restarted and forgot its configuration: call recover()"
        if self.missed >= MISSED:
            return "lost", f"{name} is mute: no answer for {self.missed} cycles"
        if self.others >= BEATS:
            return "lost", f"{name} sends no heartbeat while the others do"
        if self.error:
            return "stopped", f"{name} stopped itself, {error_words(self.error)}: call recover()"
        if self.nmt not in (OPERATIONAL, 0x00):
            kind: HealthState = "stopped" if self.nmt == PRE_OPERATIONAL else "lost"
            return kind, f"{name} left NMT state OPERATIONAL (0x{self.nmt:02X}): call recover()"
        if enabled and self.state is not DriveStatus.ENABLED:
            return "stopped", f"{name} is in state {self.state.value}: call recover()"
        return None
