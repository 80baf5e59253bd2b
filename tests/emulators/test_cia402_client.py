"""An unmodified canopen client (BaseNode402) and the emulator's drive, and its data sheet."""

import contextlib
import threading
import time
from importlib import resources

import canopen
import pytest
from canopen.profiles.p402 import BaseNode402

from can_drives import NODE, RATINGS, SimulatedBus
from robot_emulators.can_bus import Frame
from robot_emulators.medrue.drive import DriveEmulator

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
        self.drive = DriveEmulator(NODE, self._came, RATINGS, 0.0, 0.1, threading.RLock())
        self.drive.boot()
        self._running, self._actual = True, 0.0
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def send_message(self, can_id, data, remote=False):
        self.drive.hear(time.monotonic(), Frame(can_id, bytes(data), False, remote))

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


def wait(holds, seconds=5.0):
    end = time.monotonic() + seconds
    while not holds() and time.monotonic() < end:
        time.sleep(0.005)
    assert holds()


def powered(node):
    """With an RPDO of controlword and mode, a TPDO of statusword and mode, both event-driven."""
    node.nmt.state = "PRE-OPERATIONAL"
    node.pdo.read()
    for pdo, names in ((node.rpdo[1], (0x6040, 0x6060)), (node.tpdo[1], (0x6041, 0x6061))):
        pdo.clear()
        for index in names:
            pdo.add_variable(index)
        pdo.trans_type, pdo.event_timer, pdo.enabled = 255, 0, True
    node.tpdo[1].event_timer = 20
    node.pdo.save()
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
    wait(lambda: node.state == "FAULT")
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
    wait(lambda: node.statusword & 0x1000)
    node.controlword = 0x0F
    wait(lambda: node.statusword & 0x0400)
    assert abs(node.sdo[0x6064].raw - 30_000) < 1100


def test_it_follows_cyclic_targets(node):
    node.nmt.state = "PRE-OPERATIONAL"
    node.pdo.read()
    for pdo, names in ((node.rpdo[1], (0x6040, 0x607A)), (node.tpdo[1], (0x6041, 0x6064))):
        pdo.clear()
        for index in names:
            pdo.add_variable(index)
        pdo.trans_type, pdo.enabled = 1, True
    node.rpdo[1].event_timer = 0
    node.pdo.save()
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
