"""What is known of one drive: its last frames, and what is wrong with it."""

import struct
from dataclasses import dataclass, field

from wrenchbed.drivers.can.cia402 import State, error_words, state_of, stopped_itself
from wrenchbed.health import State as HealthState

Trouble = tuple[HealthState, str]
"""State of health and its reason."""
MISSED = 2
"""Cycles without an answer, while others answer, after which a drive counts as mute."""
BEATS = 18
"""Heartbeats of the five others, 3.5 periods, without one of its own after which it is lost."""
OPERATIONAL = 0x05


@dataclass
class Drive:
    """A drive as the master sees it.

    Attributes:
        node: its id.
        statusword: 0x6041 of its last answer.
        position: 0x6064 of it [count].
        torque: 0x6077 of it, thousandths of the rated torque.
        answers: how many it sent.
        answered: whether since the last SYNC.
        missed: whole rounds in a row in which others answered and it did not.
        round: of answers, in which it took part last.
        error: its EMCY code, 0 where it has none.
        rebooted: whether it told a boot-up since it was configured.
        others: heartbeats of others since its own last; a silent bus is nobody's fault.
        nmt: its NMT state, of the heartbeat.
        sent: controlword that it was sent last.
        hint: error code that it had before it could tell (0x603F), 0 where it had none.
        odd: answers of another form than was asked for.
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
    odd: int = field(default=0)

    @property
    def state(self) -> State:
        """What its statusword tells."""
        return state_of(self.statusword)

    def take_answer(self, data: bytes) -> bool:
        """A TPDO; False where it is of another form than was asked for."""
        if len(data) not in (6, 8):
            self.odd += 1
            return False
        self.statusword, self.position = struct.unpack_from("<Hi", data)
        if len(data) == 8:
            (self.torque,) = struct.unpack_from("<h", data, 6)
        self.answers += 1
        self.answered = True
        return True

    def take_emergency(self, data: bytes) -> None:
        """An EMCY."""
        if len(data) == 8:
            (self.error,) = struct.unpack_from("<H", data)

    def take_heartbeat(self, data: bytes) -> None:
        """A heartbeat or a boot-up message."""
        if len(data) == 1:
            self.others = 0
            self.nmt = data[0] & 0x7F
            self.rebooted = self.rebooted or self.nmt == 0x00

    def trouble(self, enabled: bool) -> Trouble | None:
        """State of health and reason where it must not be moved on.

        Args:
            enabled: it should follow targets.

        A drive that is gone is ``lost``, one that stopped because it heard nothing ``stopped``.
        """
        name = f"drive {self.node}"
        if self.error and not stopped_itself(self.error):
            return "fault", f"{name} reports error {error_words(self.error)}: call recover()"
        if self.state in (State.FAULT, State.REACTING):
            words = f" {error_words(self.hint)}" if self.hint else ""
            return "fault", f"{name} is in fault{words}: call recover()"
        if self.rebooted:
            return "lost", f"{name} restarted and forgot its configuration: call recover()"
        if self.missed >= MISSED:
            return "lost", f"{name} is mute: no answer for {self.missed} cycles"
        if self.others >= BEATS:
            return "lost", f"{name} sends no heartbeat while the others do"
        if self.nmt not in (OPERATIONAL, 0x00):
            return "lost", f"{name} left NMT state OPERATIONAL (0x{self.nmt:02X}): call recover()"
        if self.error:
            return "stopped", f"{name} stopped itself, {error_words(self.error)}: call recover()"
        if enabled and self.state is not State.ENABLED:
            return "stopped", f"{name} is in state {self.state.value}: call recover()"
        return None
