"""The emulator's drive without a bus: dictionary, process data, watchdogs, motors' torque."""

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from can_drives import NODE, SimulatedBus
from medrue_bench import away, until
from robot_emulators.can_bus import Frame
from robot_emulators.canopen.dictionary import Abort
from robot_emulators.medrue.cia402_axis import RPDO_TIMEOUT, SYNC_ERROR
from robot_emulators.medrue.cia402_node import rated
from robot_emulators.medrue.server import CYCLE_S
from unstarted import emulated
from wrenchbed.hardware.drivers.can import CanDriver, CanOptions
from wrenchbed.hardware.drivers.can.cia402 import DriveStatus, Want, controlword, state_of
from wrenchbed.plant.realtime_robot import Body, BodyOptions
from wrenchbed.plant.serving import EmulatorOptions

T = 0.004
OFF = 1 << 31
RPDO, TPDO = (0x1400, 0x200 + NODE), (0x1800, 0x180 + NODE)
CONTROL, TARGET, MODE = 0x60400010, 0x607A0020, 0x60600008
STATUS, ACTUAL, TORQUE = 0x60410010, 0x60640020, 0x60770010


WRITTEN = (0x1400, 0x1600, 0x1800, 0x1A00, 0x6060, 0x60C2, 0x1006, 0x6065, 0x607D, 0x6040, 0x607A)
VALUES = (0, 1, 2, 3, 4, 8, 255, CONTROL, TARGET, MODE, STATUS, OFF | 0x183, 0x183, OFF | 0x203,
          0x203)  # fmt: skip


class Bench(SimulatedBus):
    """A drive whose master sends what it is told to, and whose plant runs beside it."""

    def __init__(self, period=T):
        super().__init__(ratings=rated(-100_000, 100_000, 500, 1e6, 1e5, 1e5, 20.0))
        self.period, self.effort, self.word = period, (0.0, 0.0), 0

    def tick(self, target=0, rpdo=True, sync=True, want=None):
        self.t += self.period
        if rpdo:
            if want is not None:
                self.word = controlword(want, state_of(self.drive.axis.statusword), self.word)
            raw = struct.pack("<Hi", self.word, target)
            self.drive.hear(self.t, Frame(0x200 + NODE, raw))
        if sync:
            self.drive.hear(self.t, Frame(0x080, b""))
        self.track()

    def track(self):
        self.actual = self.drive.track(self.t, self.period, self.actual, 0.0, self.effort)

    def enabled(self, cycle=0, abort=3):
        self.write(0x1006, 0, cycle, 4)
        self.write(0x1400, 5, 100, 2)
        for parameters in (0x1400, 0x1800):
            assert self.write(parameters, 2, 1, 1) == 0
        if abort is not None:
            assert self.write(0x6007, 0, abort, 2) == 0
        self.nmt(0x01)
        for _ in range(8):
            self.tick(want=Want.ENABLE)
        assert self.state is DriveStatus.ENABLED
        self.frames.clear()
        return self

    @property
    def state(self):
        return state_of(self.drive.axis.statusword)

    def emergencies(self):
        found = [frame.data for frame in self.frames if frame.can_id == 0x80 + NODE]
        return [struct.unpack_from("<H", data)[0] for data in found]


@pytest.mark.parametrize(
    "abort, state", [(None, DriveStatus.FAULT), (1, DriveStatus.FAULT),
                     (3, DriveStatus.QUICK_STOP), (0, DriveStatus.ENABLED)],
)  # fmt: skip
def test_what_a_broken_connection_does_is_the_masters_choice(abort, state):
    bench = Bench().enabled(abort=abort)
    for _ in range(40):
        bench.tick(rpdo=False)
    assert bench.state in (state, DriveStatus.REACTING if state is DriveStatus.FAULT else state)
    assert bench.write(0x6007, 0, 2, 2) == Abort.VALUE


@pytest.mark.parametrize(
    "cycle, silent, code",
    [(0, "rpdo", RPDO_TIMEOUT), (4000, "sync", SYNC_ERROR), (0, "sync", None)],
)
def test_what_stays_away_is_a_quick_stop_after_its_time(cycle, silent, code):
    """Targets after the event timer, SYNC after 25 periods where there is a period: 0.1 s both."""
    bench = Bench().enabled(cycle=cycle)
    for _ in range(24):
        bench.tick(**{silent: False})
    assert bench.state is DriveStatus.ENABLED
    for _ in range(2 if code else 80):
        bench.tick(**{silent: False})
    assert bench.emergencies() == ([code] if code else [])
    assert bench.state is (DriveStatus.QUICK_STOP if code else DriveStatus.ENABLED)
    assert bench.read(0x603F) % 0x10000 == (code or 0)


@pytest.mark.parametrize("command", [0x80, 0x02])
def test_a_node_that_leaves_operational_stops(command):
    bench = Bench().enabled()
    bench.nmt(command)
    bench.track()
    assert bench.state is DriveStatus.QUICK_STOP


@pytest.mark.parametrize("command, mode", [(0x81, 8), (0x82, 1)])
def test_a_reset_brings_the_communication_back_to_its_defaults(command, mode):
    bench = Bench()
    fresh = {key: bench.read(*key) for key in ((0x1006, 0), (0x1017, 0), (0x1400, 5), (0x1A00, 0))}
    bench.write(0x1006, 0, 4000, 4)
    bench.write(0x1017, 0, 100, 2)
    bench.write(0x1400, 5, 33, 2)
    bench.write(0x6060, 0, 1, 1)
    assert bench.map(*TPDO, STATUS) == 0
    assert all(bench.read(*key) != value for key, value in fresh.items())
    bench.frames.clear()
    bench.nmt(command)
    assert [(frame.can_id, frame.data) for frame in bench.frames] == [(0x703, b"\x00")]
    assert {key: bench.read(*key) for key in fresh} == fresh
    assert fresh == {(0x1006, 0): 0, (0x1017, 0): 0, (0x1400, 5): 0, (0x1A00, 0): 2}
    assert bench.read(0x6060) == mode  # the profile's objects forget with the node alone


def test_pdos_carry_what_they_may_and_only_modes_that_exist():
    for pdo, entry, code in (
        (RPDO, STATUS, Abort.NOT_MAPPABLE), (RPDO, MODE, 0), (TPDO, STATUS, 0), (TPDO, TORQUE, 0),
        (RPDO, 0x10000020, Abort.NOT_MAPPABLE), (TPDO, 0x60410020, Abort.NOT_MAPPABLE),
        (TPDO, 0x70000010, Abort.NOT_MAPPABLE), (TPDO, 0, Abort.NOT_MAPPABLE),
    ):  # fmt: skip
        assert Bench().map(*pdo, entry) == code
    bench = Bench()
    for parameters, can_id in (RPDO, TPDO):
        bench.write(parameters, 1, OFF | can_id, 4)
        assert bench.write(parameters + 0x200, 0, 3, 1) == Abort.NOT_MAPPABLE
        assert bench.write(parameters + 0x200, 0, 9, 1) == Abort.TOO_LONG
        bench.write(parameters, 1, can_id, 4)
    bench.enabled()
    bench.tick(want=Want.ENABLE)
    assert [frame.can_id for frame in bench.frames] == [0x183]
    bench = Bench()
    assert bench.map(*RPDO, MODE, CONTROL) == 0
    bench.nmt(0x01)
    for mode, taken in ((1, 1), (2, 1), (8, 8)):
        bench.drive.hear(bench.t, Frame(0x203, struct.pack("<BH", mode, 0)))
        bench.tick(rpdo=False)  # a synchronous RPDO acts at SYNC
        assert bench.read(0x6060) == taken


@settings(deadline=None, max_examples=30)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(WRITTEN), st.integers(0, 5), st.sampled_from(VALUES),
            st.sampled_from([1, 2, 4]),
        ),
        max_size=25,
    )
)  # fmt: skip
def test_no_writes_make_a_drive_that_fails_at_sync(writes):
    bench = Bench()
    for index, sub, value, size in writes:
        bench.write(index, sub, value, size)
    bench.nmt(0x01)
    for k in range(12):
        bench.tick(k, want=Want.ENABLE)


def test_torque_and_current_are_reported_in_thousandths_of_the_rated_ones():
    bench = Bench()
    assert (bench.read(0x6076), bench.read(0x6075)) == (20_000, 4_000)  # mN·m, mA
    assert bench.map(*TPDO, STATUS, ACTUAL, TORQUE) == 0
    bench.enabled()
    for torque, told in ((5.0, 250), (-0.021, -1), (1e4, 32767), (-1e4, -32767)):
        bench.effort = (torque, torque / 5.0)  # 5 N·m/A, as rated
        bench.track()
        bench.tick()
        (answer,) = [frame.data for frame in bench.frames if frame.can_id == 0x183]
        assert struct.unpack_from("<h", answer, 6)[0] == told
        assert told == bench.read(0x6077) == bench.read(0x6078)
        bench.frames.clear()


PLANT = "127.0.4.8"


def test_a_motor_holds_what_pushes_and_gives_nothing_at_rest():
    arm = Body(BodyOptions("medrue", noise="off"), CYCLE_S, drives=True)
    for _ in range(50):
        arm.step(arm.robot.home)
    assert np.abs(arm.drives.now.servo).max() < 1e-6
    arm._plant.data.qfrc_applied[0] = 25.0  # on the carriage
    for _ in range(1000):
        arm.step(arm.robot.home)
    assert arm.drives.now.servo[0] == pytest.approx(-25.0, abs=0.1)


@pytest.mark.wire
def test_the_drivers_effort_is_what_the_motors_give():
    rated = np.array([200.0] + 5 * [2.0])
    settings = {"port": "0"}
    with emulated("medrue", EmulatorOptions(PLANT, noise="off", setting=settings)) as emulator:
        body = emulator.plant.body
        step, given = body.step, [np.zeros(6)]

        def recorded(target, due=0.0):
            step(target, due)
            given.append(np.rint(1000.0 * body.efforts.torque / rated))

        body.step = recorded
        port = emulator.hub.port
        driver = CanDriver(CanOptions(host=PLANT, port=port, effort="torque", rate=100.0))
        with driver:
            assert driver.health().counters["arm bus_load"] < 0.9
            assert until(lambda: driver.health().ok)
            driver.move(away(driver))
            told = []
            until(lambda: told.append(driver.read().extra_columns["tau"]), 0.5)
        rows = np.unique(1000.0 * np.array(told) / rated, axis=0)
        assert np.abs(rows[:, 0]).max() > 5 and len(rows) > 5
        assert np.abs(rows - np.rint(rows)).max() < 1e-6
        known = np.array(given)
        for joint in range(6):
            assert np.isin(np.rint(rows[:, joint]), known[:, joint]).all()
        whole = [(np.rint(row) == known).all(axis=1).any() for row in rows]
        assert np.mean(whole) > 0.8  # the plant may step between two drives' answers
