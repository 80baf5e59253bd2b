"""The emulator's drive: an unmodified canopen client, its data sheet, what CiA 301 and 402 ask."""

import contextlib
import struct
import threading
import time
from importlib import resources

import canopen
import pytest
from canopen.profiles.p402 import BaseNode402

from can_drives import NODE, RATINGS, SimulatedBus
from robot_emulators.can_bus import Frame
from robot_emulators.medrue.cia402_node import DriveEmulator
from wrenchbed.hardware.device_base import wait_until

EDS = resources.files("robot_emulators.medrue") / "cia402.eds"


def test_canopen_reads_the_data_sheet_as_the_emulator_does():
    drive = SimulatedBus().drive
    sheet = canopen.import_od(str(EDS), node_id=NODE)
    variables = {
        (variable.index, variable.subindex): variable
        for thing in sheet.values()
        for variable in (thing.values() if hasattr(thing, "subindices") else [thing])
    }
    assert set(variables) == set(drive.objects)
    for key, variable in variables.items():
        entry = drive.objects.entry(key)
        assert (variable.access_type, variable.pdo_mappable) == (entry.access, entry.mapped)
        assert (variable.min, variable.max) == (entry.low, entry.high)
        if entry.size:
            assert (len(variable), variable.default) == (8 * entry.size, entry.default)
            assert (variable.data_type in canopen.objectdictionary.SIGNED_TYPES) == entry.signed


class Wire(canopen.Network):
    """A network whose bus is the drive itself, with a thread for its time."""

    def __init__(self):
        super().__init__()
        self.drive = DriveEmulator(NODE, self._came, RATINGS, 0.0, threading.RLock())
        self.drive.boot()
        self._running, self._actual = True, 0.0
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def send_message(self, can_id, data, remote=False):
        self.drive.hear(time.monotonic(), Frame(can_id, bytes(data)))

    def send_periodic(self, can_id, data, period, remote=False):
        raise NotImplementedError

    def _came(self, frame):
        self.notify(frame.can_id, bytearray(frame.data), time.monotonic())

    def _run(self):
        while self._running:
            time.sleep(0.004)
            t = time.monotonic()
            before = self._actual
            with self.drive.lock:
                self._actual = self.drive.track(t, 0.004, before, self._speed(before), (0.0, 0.0))
            self.drive.tick(t)

    def _speed(self, before):
        speed, self._before = (before - getattr(self, "_before", before)) / 0.004, before
        return speed

    def stop(self):
        self._running = False
        self._thread.join()


@pytest.fixture
def node():
    wire = Wire()
    node = BaseNode402(NODE, canopen.import_od(str(EDS), node_id=NODE))
    wire.add_node(node)
    with contextlib.closing(wire):
        wire.close = wire.stop
        yield node


def mapped(node, received, sent, kind, timer):
    """With an RPDO and a TPDO of objects, of a transmission type; the TPDO also by its timer."""
    node.nmt.state = "PRE-OPERATIONAL"
    node.pdo.read()
    for pdo, names in ((node.rpdo[1], received), (node.tpdo[1], sent)):
        pdo.clear()
        for index in names:
            pdo.add_variable(index)
        pdo.trans_type, pdo.event_timer, pdo.enabled = kind, 0, True
    node.tpdo[1].event_timer = timer
    node.pdo.save()


def powered(node):
    mapped(node, (0x6040, 0x6060), (0x6041, 0x6061), 255, 20)
    node.nmt.state = "OPERATIONAL"
    node.setup_402_state_machine(read_pdos=False)
    node.op_mode = "PROFILED POSITION"
    node.state = "OPERATION ENABLED"
    return node


def test_it_powers_up_by_pdo_and_goes_down(node):
    powered(node)
    assert node.state == "OPERATION ENABLED" and node.op_mode == "PROFILED POSITION"
    for state in ("SWITCHED ON", "READY TO SWITCH ON", "SWITCH ON DISABLED"):
        node.state = state
        assert node.state == state


def test_a_fault_is_reset(node):
    powered(node)
    wire = node.network
    with wire.drive.lock:
        wire.drive.axis.fault(0x2310)
    assert wait_until(lambda: node.state == "FAULT", 5.0)
    assert [e.code for e in node.emcy.active] == [0x2310]
    node.reset_from_fault()
    assert node.state == "OPERATION ENABLED" and node.emcy.active == []


def test_it_homes(node):
    powered(node)
    node.sdo[0x6098].raw = 37
    node.sdo[0x607C].raw = 4321
    assert node.homing(timeout=5.0, restore_op_mode=True)
    assert abs(node.sdo[0x6064].raw - 4321) <= 2
    assert node.op_mode == "PROFILED POSITION"


def test_it_moves_in_profile_position_mode(node):
    powered(node)
    node.sdo[0x607A].raw = 30_000
    node.controlword = 0x1F
    assert wait_until(lambda: node.statusword & 0x1000, 5.0)
    node.controlword = 0x0F
    assert wait_until(lambda: node.statusword & 0x0400, 5.0)
    assert abs(node.sdo[0x6064].raw - 30_000) < 1100


def test_it_moves_as_it_comes(node):
    """No process data are configured, and nobody sends SYNC."""
    node.nmt.state = "PRE-OPERATIONAL"
    node.setup_402_state_machine()
    node.nmt.state = "OPERATIONAL"
    node.op_mode = "PROFILED POSITION"
    node.state = "OPERATION ENABLED"
    time.sleep(0.2)  # nothing asks a master to repeat itself
    node.rpdo[1][0x607A].raw = 30_000
    node.controlword = 0x1F
    assert wait_until(lambda: abs(node.sdo[0x6064].raw - 30_000) < 1100, 5.0)
    assert node.state == "OPERATION ENABLED"


def test_it_follows_cyclic_targets(node):
    mapped(node, (0x6040, 0x607A), (0x6041, 0x6064), 1, 0)
    node.sdo[0x6060].raw = 8
    node.sdo[0x60C2][1].raw = 10
    node.nmt.state = "OPERATIONAL"
    for k in range(100):
        node.rpdo[1][0x6040].raw = (0x06, 0x07, 0x0F)[min(k // 5, 2)]
        node.rpdo[1][0x607A].raw = 50 * min(max(0, k - 15), 60)
        node.rpdo[1].transmit()
        node.network.sync.transmit()
        time.sleep(0.01)
    assert node.tpdo[1][0x6041].raw & 0x126F == 0x1227
    assert abs(node.tpdo[1][0x6064].raw - 50 * 60) < 50


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
        answer = bus.ask(struct.pack("<BHB4x", 0x40, index, sub))
        assert struct.unpack_from("<BHBI", answer)[3] == code
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
    assert bus.read(0x1001) == 0x03


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


def moves(bus):
    def enabled(mode):
        assert bus.write(0x6060, 0, mode, 1) == 0
        assert [bus.control(word) & 0x6F for word in (0x06, 0x07, 0x0F)] == [0x21, 0x23, 0x27]
        assert bus.read(0x6061) == mode

    enabled(1)
    for target, word, place in ((20_000, 0x1F, 20_000), (5_000, 0x1F, 5_000)):
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
     transmits_at_sync, transmits_events, takes_targets_at_sync,
     moves],
    ids=lambda check: check.__name__,
)  # fmt: skip
def test_the_emulators_drive(check):
    check(SimulatedBus())
