"""Rules of CiA 301 and 402 that the emulator's drive keeps, and drives that break one are noticed.

SDO transfers are those of the canopen library, which checks toggle bits and CRCs itself.
"""

import struct

import canopen
import pytest
from canopen.sdo.exceptions import SdoAbortedError, SdoError

from can_drives import DEFECTS, FURTHER, NODE, SimulatedBus

READY, SWITCHED_ON, ENABLED, DISABLED, FAULT, QUICK_STOP = 0x21, 0x23, 0x27, 0x40, 0x08, 0x07


class Master(canopen.Network):
    """A network whose bus is one drive without real time; keeps what the drive sends."""

    def __init__(self, kind):
        super().__init__()
        self.bus, self.heard = SimulatedBus(kind), []
        self.drive = self.bus.drive
        self.sdo = self.add_node(canopen.RemoteNode(NODE, canopen.ObjectDictionary())).sdo
        self.sdo.RESPONSE_TIMEOUT = 0.01

    def send_message(self, can_id, data, remote=False):
        self.bus.send(can_id, bytes(data), remote)
        self.run(0.0)

    def run(self, seconds):
        """Let some time pass [s]; the frames that came."""
        first, end = len(self.heard), self.bus.t + seconds
        while (frame := self.bus.receive(max(0.0, end - self.bus.t))) is not None:
            self.heard.append(frame)
            self.notify(frame.can_id, bytearray(frame.data), frame.t)
        return self.heard[first:]

    def count(self, can_id, seconds):
        return sum(frame.can_id == can_id for frame in self.run(seconds))

    def read(self, index, sub=0):
        return int.from_bytes(self.sdo.upload(index, sub), "little", signed=index == 0x6064)

    def write(self, index, sub, value, size):
        self.sdo.download(index, sub, (value % (1 << 8 * size)).to_bytes(size, "little"))

    def refused(self, *arguments):
        """The abort code of a write or, with fewer arguments, of a read."""
        with pytest.raises(SdoAbortedError) as refusal:
            (self.write if len(arguments) > 2 else self.read)(*arguments)
        return refusal.value.code

    def answer(self, request):
        """The drive's answer to the bytes of an SDO request."""
        first = len(self.heard)
        self.send_message(0x600 + NODE, request.ljust(8, b"\0"))
        return next(f.data for f in self.heard[first:] if f.can_id == 0x580 + NODE)

    def order(self, command):
        self.send_message(0, bytes([command, NODE]))
        self.run(0.05)

    def cycle(self):
        first = len(self.heard)
        self.send_message(0x080, b"")
        self.run(0.01)
        return [f for f in self.heard[first:] if f.can_id == 0x180 + NODE]

    def control(self, *words):
        for word in words:
            self.write(0x6040, 0, word, 2)
            self.run(0.02)
        return self.state

    @property
    def state(self):
        word = self.read(0x6041)
        return word & 0x4F if word & 0x08 or word & 0x40 else word & 0x6F

    def enabled(self, mode):
        self.write(0x6060, 0, mode, 1)
        assert self.control(0x06, 0x07, 0x0F) == ENABLED

    def map(self, index, can_id, kind, *entries, timer=0, inhibit=0):
        """A PDO with objects; ``kind`` is its transmission type, times in units of the standard."""
        self.order(0x80)
        self.write(index, 1, 1 << 31 | can_id, 4)
        self.write(index + 0x200, 0, 0, 1)
        for sub, entry in enumerate(entries, start=1):
            self.write(index + 0x200, sub, entry, 4)
        self.write(index + 0x200, 0, len(entries), 1)
        self.write(index, 2, kind, 1)
        self.write(index, 3, inhibit, 2)
        self.write(index, 5, timer, 2)
        self.write(index, 1, can_id, 4)


def rule_what_is_not_there_has_its_abort_code(m):
    assert m.refused(0x1F00) == 0x06020000
    assert m.refused(0x1018, 9) == 0x06090011
    assert m.refused(0x603F, 0, 1, 2) == 0x06010002


def rule_texts_come_in_segments(m):
    assert len(m.sdo.upload(0x1008, 0)) > 7


def rule_a_segment_with_a_wrong_toggle_bit_is_refused(m):
    assert m.answer(struct.pack("<BHBI", 0x21, 0x6081, 0, 4))[0] == 0x60
    refusal = m.answer(bytes([0x10 | 3 << 1 | 1]) + b"\x10\x27\0\0")
    assert (refusal[0], struct.unpack_from("<I", refusal, 4)[0]) == (0x80, 0x05030000)


def rule_the_state_machine_goes_step_by_step(m):
    assert m.control(0x0F) == DISABLED
    assert [m.control(word) for word in (0x06, 0x07, 0x0F)] == [READY, SWITCHED_ON, ENABLED]
    assert [m.control(word) for word in (0x07, 0x06, 0x00)] == [SWITCHED_ON, READY, DISABLED]


def rule_a_quick_stop_shows_bit_5_low(m):
    m.enabled(8)
    assert m.control(0x02) == QUICK_STOP


def rule_a_fault_is_reported_and_reset_by_a_rising_edge(m):
    m.control(0x80)
    for code in (0x4210, 0x2310):
        m.drive.axis.fault(code)
        emergencies = [f.data[:2] for f in m.run(0.1) if f.can_id == 0x080 + NODE]
        assert emergencies == [code.to_bytes(2, "little")]
        assert m.state == FAULT and m.read(0x603F) == code and m.read(0x1001) & 1
        assert m.control(0x80) == FAULT  # the bit was set before
        assert m.control(0x00, 0x80) == DISABLED
    assert [m.read(0x1003, sub) & 0xFFFF for sub in (1, 2)] == [0x2310, 0x4210]
    assert m.refused(0x1003, 0, 1, 1) == 0x06090030
    m.write(0x1003, 0, 0, 1)
    assert m.read(0x1003) == 0


def rule_heartbeats_have_their_period(m):
    m.write(0x1017, 0, 100, 2)
    m.run(0.2)
    assert 9 <= m.count(0x700 + NODE, 1.0) <= 11


def rule_a_missed_heartbeat_is_noticed(m):
    m.write(0x1016, 1, 0x7F << 16 | 100, 4)
    m.send_message(0x77F, b"\x05")
    assert m.count(0x080 + NODE, 0.5) == 1
    m.write(0x1016, 1, 0, 4)


def rule_a_reset_boots(m):
    m.order(0x82)
    assert [f.data for f in m.heard if f.can_id == 0x700 + NODE][-1:] == [b"\0"]


def rule_a_stopped_node_hears_nmt_alone(m):
    m.write(0x1017, 0, 20, 2)
    m.order(0x02)
    with pytest.raises(SdoError):
        m.read(0x1000)
    beats = {f.data for f in m.run(0.1) if f.can_id == 0x700 + NODE}
    m.order(0x80)
    assert beats == {b"\x04"} and m.read(0x1000) & 0xFFFF == 402


def rule_a_mapping_in_use_is_not_changed(m):
    m.map(0x1800, 0x180 + NODE, 1, 0x60410010)
    assert m.refused(0x1A00, 0, 0, 1) >> 16 in (0x0601, 0x0800)


def rule_synchronous_pdos_have_their_length_and_turn(m):
    m.map(0x1800, 0x180 + NODE, 1, 0x60410010, 0x60640020)
    m.order(0x01)
    assert [len(frame.data) for frame in m.cycle()] == [6]
    m.map(0x1800, 0x180 + NODE, 3, 0x60410010)
    m.order(0x01)
    assert sum(len(m.cycle()) for _ in range(9)) == 3


def rule_event_pdos_come_by_their_timer_and_not_too_often(m):
    m.map(0x1800, 0x180 + NODE, 255, 0x60410010, timer=50)
    m.order(0x01)
    m.run(0.1)
    assert 9 <= m.count(0x180 + NODE, 0.5) <= 11
    m.map(0x1800, 0x180 + NODE, 255, 0x60410010, inhibit=1000)  # 0.1 s
    m.order(0x01)
    m.run(0.2)
    for word in (0x06, 0x07, 0x06, 0x07):  # four changes within 0.04 s
        m.write(0x6040, 0, word, 2)
        m.run(0.01)
    assert sum(f.can_id == 0x180 + NODE for f in m.heard if f.t > m.bus.t - 0.04) <= 1


def rule_received_pdos_act_in_operational_at_sync(m):
    m.map(0x1400, 0x200 + NODE, 255, 0x60400010)
    m.send_message(0x200 + NODE, b"\x06\0")
    m.run(0.02)
    assert m.state == DISABLED
    m.map(0x1400, 0x200 + NODE, 1, 0x60400010)
    m.order(0x01)
    m.send_message(0x200 + NODE, b"\x06\0")
    m.run(0.02)
    assert m.state == DISABLED
    m.cycle()
    assert m.state == READY


def rule_the_shown_mode_is_the_one_that_was_set(m):
    for mode in (1, 3, 6, 8):
        m.write(0x6060, 0, mode, 1)
        m.run(0.02)
        assert m.read(0x6061) == mode


def rule_set_points_are_acknowledged_reached_and_relative(m):
    m.write(0x6081, 0, 80_000, 4)
    m.enabled(1)
    for word, place in ((0x1F, 10_000), (0x5F, 20_000)):
        m.write(0x607A, 0, 10_000, 4)
        m.control(word)
        assert m.read(0x6041) & 0x1000
        m.control(word & 0x4F)
        assert not m.read(0x6041) & 0x1000
        m.run(2.0)
        assert m.read(0x6041) & 0x0400 and abs(m.read(0x6064) - place) < 1100


def rule_halt_stops_a_speed(m):
    m.enabled(3)
    m.write(0x60FF, 0, 20_000, 4)
    m.run(0.5)
    assert m.read(0x606C) > 10_000
    m.control(0x10F)
    m.run(0.5)
    assert m.read(0x606C) in (0, *range(100), *range(2**32 - 100, 2**32))


def rule_homing_ends_with_bit_12(m):
    m.enabled(6)
    m.write(0x6098, 0, 37, 1)
    m.control(0x1F)
    m.run(1.0)
    assert m.read(0x6041) & 0x3400 == 0x1400


RULES = [f for name, f in sorted(globals().items()) if name.startswith("rule_")]


@pytest.mark.parametrize("rule", RULES, ids=lambda f: f.__name__[5:])
def test_the_emulators_drive_keeps_the_rule(rule):
    rule(Master(type(SimulatedBus().drive)))


@pytest.mark.parametrize("defect", DEFECTS | FURTHER)
def test_a_drive_that_breaks_a_rule_is_noticed(defect):
    broken = []
    for rule in RULES:
        try:
            rule(Master((DEFECTS | FURTHER)[defect]))
        except (Exception, pytest.fail.Exception) as error:
            broken.append((rule.__name__, error))
    assert broken
