"""What CiA 301 and CiA 402 ask of a drive: the emulator's does it."""

import struct

import pytest

from can_drives import NODE, SimulatedBus

TEXT = b"wrenchbed CiA 402 drive"
ON = 0x280 + NODE
"""Id of the second TPDO."""


def obeys_nmt(bus):
    bus.nmt(0x81)
    assert (0x700 + NODE, b"\0") in [(frame.can_id, frame.data) for frame in bus.frames]
    bus.nmt(0x02)
    assert bus.ask(struct.pack("<BHB4x", 0x40, 0x1000, 0)) is None  # STOPPED serves no SDO
    bus.nmt(0x80)
    assert bus.read(0x1000) == 0x20192


def beats(bus):
    bus.write(0x1017, 0, 50, 2)
    assert 19 <= len(bus.heard(0x700 + NODE, 1.0)) <= 21


def misses_heartbeats(bus):
    assert bus.write(0x1016, 1, 0x7D << 16 | 100, 4) == 0
    bus.nmt(0x01)
    bus.hear(0x77D, b"\x05")
    assert [data[:2] for data in bus.heard(0x80 + NODE, 0.2)] == [b"\x30\x81"]


def refuses_by_code(bus):
    for index, sub, code in ((0x5FFF, 0, 0x06020000), (0x1018, 9, 0x06090011)):
        assert (
            struct.unpack_from("<BHBI", bus.ask(struct.pack("<BHB4x", 0x40, index, sub)))[3] == code
        )
    assert bus.write(0x603F, 0, 1, 2) == 0x06010002
    assert bus.write(0x6060, 0, 8, 2) == 0x06070012
    assert bus.write(0x60C2, 2, 0, 1) == 0x06090031
    assert bus.write(0x6007, 0, 2, 2) == 0x06090030


def transfers_segments(bus):
    begin = struct.pack("<BHB4x", 0x40, 0x1008, 0)
    size = struct.unpack_from("<I", bus.ask(begin), 4)[0]
    got, k = b"", 0
    while len(got) < size:
        answer = bus.ask(bytes([0x60 | k % 2 << 4]).ljust(8, b"\0"))
        assert answer[0] >> 4 == k % 2
        got, k = got + answer[1 : 8 - (answer[0] >> 1 & 7)], k + 1
    assert got == TEXT and answer[0] & 1
    bus.ask(begin)
    refused = bus.ask(bytes([0x70]).ljust(8, b"\0"))
    assert struct.unpack_from("<BHBI", refused) == (0x80, 0x1008, 0, 0x05030000)
    assert bus.ask(struct.pack("<BHB4x", 0xA0, 0x1008, 0))[4:] == b"\x01\0\x04\x05"  # no blocks


def reports_errors(bus):
    for code in (0x2310, 0x5441):
        bus.drive.axis.fault(code)
        assert [struct.unpack_from("<H", data)[0] for data in bus.heard(0x80 + NODE, 0.01)] == [
            code
        ]
    assert (bus.read(0x1003, 1), bus.read(0x1003, 2), bus.read(0x1001)) == (0x5441, 0x2310, 0x03)


def transmits_at_sync(bus):
    assert bus.write(0x1A00, 0, 0, 1) == 0x08000022  # while it is switched on
    assert bus.map(0x1800, 0x180 + NODE, 0x60410010, 0x60640020) == 0
    assert bus.write(0x1800, 2, 3, 1) == 0
    bus.nmt(0x01)
    lengths = []
    for _ in range(9):
        bus.hear(0x080)
        lengths += [len(data) for data in bus.heard(0x180 + NODE)]
    assert lengths == [6, 6, 6]


def transmits_events(bus):
    bus.nmt(0x80)
    assert bus.write(0x1801, 1, 1 << 31 | ON, 4) == 0
    for sub, value, size in ((2, 255, 1), (5, 50, 2), (1, ON, 4)):
        assert bus.write(0x1801, sub, value, size) == 0
    bus.nmt(0x01)
    assert abs(len(bus.heard(ON, 0.5)) - 10) <= 1


def takes_targets_at_sync(bus):
    target = struct.pack("<Hi", 0x06, 0)
    for kind in (255, 1):
        assert bus.write(0x1400, 2, kind, 1) == 0
        bus.hear(0x200 + NODE, target)
        bus.hear(0x080)
        assert bus.read(0x6040) == 0  # not operational
    bus.nmt(0x01)
    bus.hear(0x200 + NODE, target)
    assert bus.read(0x6040) == 0
    bus.hear(0x080)
    assert bus.read(0x6040) == 0x06


def climbs(bus):
    for word, state in (
        (0x0F, 0x40), (0x06, 0x21), (0x07, 0x23), (0x0F, 0x27), (0x07, 0x23), (0x0F, 0x27),
        (0x02, 0x07), (0x00, 0x40),
    ):  # fmt: skip
        assert bus.control(word) & 0x6F == state


def resets_faults_by_an_edge(bus):
    bus.control(0x80)
    bus.drive.axis.fault(0x2310)
    assert [bus.control(word) & 0x4F for word in (0x80, 0x00, 0x80)] == [0x08, 0x08, 0x40]


def moves(bus):
    def enabled(mode):
        assert bus.write(0x6060, 0, mode, 1) == 0
        assert [bus.control(word) & 0x6F for word in (0x06, 0x07, 0x0F)] == [0x21, 0x23, 0x27]
        assert bus.read(0x6061) == mode

    enabled(1)
    for target, word, place in ((20_000, 0x1F, 20_000), (5_000, 0x5F, 25_000)):
        bus.write(0x607A, 0, target, 4)
        assert bus.control(word) & 0x1000  # taken
        bus.wait(1.0)
        assert bus.read(0x6062) == place and not bus.control(0x0F) & 0x1000
    bus.write(0x607A, 0, -200_000, 4)
    bus.control(0x1F)
    bus.wait(0.2)
    assert bus.read(0x606B) < 0
    bus.control(0x11F)
    bus.wait(0.5)
    assert bus.read(0x606B) == 0 and bus.read(0x6062) > -200_000
    bus.control(0x06)
    enabled(6)
    bus.write(0x6098, 0, 37, 1)
    bus.control(0x1F)
    bus.wait(0.1)
    assert bus.control(0x1F) & 0x3000 == 0x1000


@pytest.mark.parametrize(
    "check",
    [obeys_nmt, beats, misses_heartbeats, refuses_by_code, transfers_segments, reports_errors,
     transmits_at_sync, transmits_events, takes_targets_at_sync, climbs, resets_faults_by_an_edge,
     moves],
    ids=lambda check: check.__name__,
)  # fmt: skip
def test_the_emulators_drive(check):
    check(SimulatedBus())
