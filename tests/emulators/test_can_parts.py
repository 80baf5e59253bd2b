"""The driver's parts without a bus: states, ids, rates, detection counted in cycles."""

import gc
import struct
import threading
import weakref

import numpy as np
import pytest

from robot_emulators.medrue import cia402_axis as served
from robot_emulators.medrue.cia402_node import DriveEmulator, rated
from wrenchbed.errors import ParameterError
from wrenchbed.hardware.drivers.can import CanOptions, options
from wrenchbed.hardware.drivers.can.cia402 import (
    BEATS,
    DriveState,
    DriveStatus,
    Want,
    controlword,
    state_of,
)
from wrenchbed.hardware.drivers.can.cycle import Cycle, Following
from wrenchbed.hardware.drivers.can.setpoints import Setpoints

T = 0.004
TOP = np.ones(6)


@pytest.mark.parametrize(
    "word, state",
    [(0x0250, DriveStatus.DISABLED), (0x0231, DriveStatus.READY), (0x0233, DriveStatus.SWITCHED_ON),
     (0x1237, DriveStatus.ENABLED), (0x0217, DriveStatus.QUICK_STOP), (0x0218, DriveStatus.FAULT),
     (0x021F, DriveStatus.REACTING), (0x0000, DriveStatus.NOT_READY), (0x2238, DriveStatus.FAULT)],
)  # fmt: skip
def test_statuswords_of_the_profile(word, state):
    assert state_of(word) is state


def made(position):
    ratings = rated(-1000, 100_000, 500, 1e6, 1e5, 1e5, 10.0)
    drive = DriveEmulator(1, lambda frame: None, ratings, position, threading.RLock())
    return drive.axis


def climb(axis, want, cycles=10):
    word = 0
    for _ in range(cycles):
        word = controlword(want, state_of(axis.statusword), word)
        axis.control(word)
        axis.advance(0.0, T, axis.command)
    return state_of(axis.statusword)


def test_master_and_drive_agree_on_the_way_up_and_out_of_a_fault():
    axis = made(100.0)
    assert climb(axis, Want.ENABLE) is DriveStatus.ENABLED
    assert climb(axis, Want.QUICK_STOP) is DriveStatus.QUICK_STOP
    assert climb(axis, Want.RESET) is DriveStatus.DISABLED
    climb(axis, Want.ENABLE)
    axis.fault(0x2310)
    assert climb(axis, Want.ENABLE) is DriveStatus.FAULT  # nothing but a reset leaves it
    assert climb(axis, Want.RESET) is DriveStatus.DISABLED
    assert axis.raised == [0x2310, 0]
    assert climb(axis, Want.ENABLE) is DriveStatus.ENABLED


def test_targets_jump_by_no_more_than_the_following_error_and_stay_within_the_limits():
    axis = made(0.0)
    climb(axis, Want.ENABLE)
    axis.sync(0.0, 400.0, T)
    assert axis.state is served.AxisState.ENABLED
    axis.sync(T, 501.0, T)
    assert axis.state is served.AxisState.FAULT and axis.code == 0x8611
    axis = made(-900.0)
    climb(axis, Want.ENABLE)
    axis.sync(0.0, -1200.0, T)
    axis.advance(T, T, -900.0)
    assert axis.command == -1000.0 and axis.statusword & 1 << 11


@pytest.mark.parametrize("late", [0.0, 0.3, 0.85])
def test_uneven_syncs_make_an_even_path(late):
    axis, rng = made(0.0), np.random.default_rng(0)
    climb(axis, Want.ENABLE)
    way = []
    for k in range(300):
        axis.sync(k * T + late * T * (rng.random() if k else 0.0), 2.0 * (k + 1), T)
        way.append(axis.advance((k + 0.9) * T, T, axis.command))
    steps = np.diff(way)[5:]
    assert np.abs(steps - 2.0).max() < 0.02 * 2.0


def test_a_path_ends_at_its_last_target_and_goes_on_after_a_gap():
    axis = made(0.0)
    climb(axis, Want.ENABLE)
    axis.sync(0.0, 20.0, T)
    assert [axis.advance(k * T / 2, T / 2, axis.command) for k in (1, 2, 3)] == [10.0, 20.0, 20.0]
    axis.sync(10 * T, 40.0, T)
    assert axis.advance(10.5 * T, T, axis.command) == pytest.approx(30.0)
    axis.sync(11 * T, 60.0, T)  # of a running stream: two more are awaited on its line
    way = [axis.advance((11 + k) * T, T, axis.command) for k in (1.0, 1.5, 3.0, 5.0)]
    assert way == pytest.approx([60.0, 70.0, 100.0, 100.0])


def test_bus_load_and_interpolation_period_by_hand():
    worst = 55 + 305 + 6 * (115 + 135)
    load = CanOptions(rate=250.0, effort="torque").bus_load
    assert load == pytest.approx((worst * 250 + 7 * 10 * 65) / 1e6)
    assert CanOptions(rate=250.0).interpolation == (4, -3)
    assert CanOptions(rate=400.0).interpolation == (25, -4)
    assert CanOptions(rate=500.0).bus_load < 0.9


def test_ids_that_collide_are_refused_with_the_remedy():
    with pytest.raises(ParameterError, match=r"0x201 is RPDO1 of node 1.*base 0x68"):
        CanOptions(base=0x20)
    with pytest.raises(ParameterError, match="SYNC"):
        CanOptions(base=0x08)
    with pytest.raises(ParameterError, match="heartbeat of node 1"):
        CanOptions(base=0x70)
    assert CanOptions(base=0x20, nodes=(17, 18, 19, 20, 21, 22)).base == 0x20
    for base in range(0x68, 0x6E):
        options.check(base, tuple(range(1, 128)))


def points():
    setpoints = Setpoints(T, -np.ones(6), np.ones(6), TOP)
    setpoints.hold(np.zeros(6))
    return setpoints


class Wire:
    """A link that carries nothing; keeps what was sent."""

    def __init__(self):
        self.sent = []

    def listen(self, heard):
        self.heard = heard

    def leave(self, heard):
        pass

    def send(self, can_id, data):
        self.sent.append((can_id, data))


class Bench:
    """Six drives that answer, a cycle at a time."""

    def __init__(self):
        self.wire, self.now = Wire(), 0.0
        self.setpoints = points()
        self.cycle = Cycle(self.wire, [DriveState(n) for n in range(1, 7)], np.full(6, 1e6),
                           self.setpoints, lambda: None, Following(TOP), T, 127)  # fmt: skip
        self.words = dict.fromkeys(range(1, 7), 0x1237)
        self.mute = set()
        self.cycle.want = Want.ENABLE

    def tick(self):
        self.wire.sent.clear()
        self.cycle._evaluate()
        self.cycle._send()
        for node, word in self.words.items():
            if node not in self.mute:
                raw = struct.pack("<Hi", word, 0)
                self.cycle._received(1.0, 0x180 + node, raw)

    def controlwords(self):
        rpdos = {i - 0x200: d for i, d in self.wire.sent if 0x200 < i < 0x207}
        return {node: struct.unpack_from("<H", data)[0] for node, data in rpdos.items()}


def test_a_mute_drive_or_an_emergency_stops_all_others():
    bench = Bench()
    for _ in range(5):
        bench.tick()
    assert set(bench.controlwords().values()) == {0x0F} and bench.cycle.following
    bench.mute = {3}
    cycles = 0
    while bench.cycle.latched is None:
        bench.tick()
        cycles += 1
    assert cycles == 3  # asked in the first, missed in it and the second, judged as the third began
    assert bench.cycle.latched == ("lost", "drive 3 is mute: no answer for 2 cycles")
    assert set(bench.controlwords().values()) == {0x02}
    bench = Bench()
    for _ in range(5):
        bench.tick()
    bench.cycle._received(1.0, 0x085, struct.pack("<HB5x", 0x2310, 1))
    assert bench.cycle.latched[0] == "fault" and "over-current" in bench.cycle.latched[1]
    bench.tick()
    assert set(bench.controlwords().values()) == {0x02}


def test_one_lost_answer_or_a_silent_bus_is_no_alarm_and_a_missing_heartbeat_is():
    bench = Bench()
    for k in range(20):
        bench.mute = {2} if k % 3 == 0 else set()
        bench.tick()
    assert bench.cycle.latched is None and bench.cycle.incomplete > 3
    bench.mute = set(range(1, 7))
    for _ in range(20):
        bench.tick()
    assert bench.cycle.latched is None
    bench = Bench()
    bench.tick()
    beats = 0
    while bench.cycle.latched is None and beats < 100:
        bench.cycle._received(1.0, 0x701 + beats % 5, b"\x05")  # nodes 1 … 5
        bench.tick()
        beats += 1
    assert bench.cycle.latched == ("lost", "drive 6 sends no heartbeat while the others do")
    assert beats == BEATS


@pytest.mark.parametrize(
    "can_id, data, state, named",
    [(0x703, b"\x00", "lost", "drive 3 restarted"), (0x703, b"\x7f", "stopped", "left NMT"),
     (0x083, struct.pack("<HB5x", 0x8250, 17), "stopped", "no targets")],
)  # fmt: skip
def test_what_a_drive_says_of_itself(can_id, data, state, named):
    bench = Bench()
    bench.tick()
    bench.cycle._received(1.0, can_id, data)
    bench.tick()
    assert bench.cycle.latched[0] == state and named in bench.cycle.latched[1]


def test_no_garbage_is_frozen_while_the_cycle_runs():
    bench, kept = Bench(), Bench()
    kept.itself, gone = kept, weakref.ref(kept)
    gc.collect()  # it is old: a young one would be collected soon
    del kept
    bench.cycle._keep_time = lambda: None
    bench.cycle._run()
    assert gone() is None
