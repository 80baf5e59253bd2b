"""What the driver does not do: move by itself, drop an axis, trust drives that it did not check."""

import time
from contextlib import nullcontext

import numpy as np
import pytest

from can_servos import BEAT, GUARDS, Bus, Sensor, Servo, T
from medrue_bench import until
from wrenchbed.errors import DriverError, LinkError
from wrenchbed.hardware import device_base
from wrenchbed.hardware.drivers.can import (
    CanDriver,
    CanOptions,
    cycle,
    drive_configuration,
    driver,
    options,
)
from wrenchbed.hardware.drivers.can.options import HEARTBEAT_S

pytestmark = pytest.mark.wire
SLOW = 0.02 * 0.25 * 1e6 + 80.0
"""What counts as rest [count/s]."""


@pytest.fixture
def arm(monkeypatch):
    """The driver on six servos at home; `arm.buses` are the ones that it opened."""
    monkeypatch.setattr(cycle, "REST_S", 0.25)  # these servos stop sooner
    one = CanDriver(CanOptions())
    one.transducer = Sensor()
    home = one.robot.home * np.array(one.setting.counts_per_unit)
    one.servos = [Servo(k + 1, float(round(q))) for k, q in enumerate(home)]
    one.buses = []

    def opened(*_):
        one.buses.append(Bus(one.servos))
        return one.buses[-1]

    monkeypatch.setattr(driver, "open_bus", opened)
    for module in (cycle, driver, device_base):  # other processes may keep this machine busy
        monkeypatch.setattr(module, "STALE_S", 0.3)
    monkeypatch.setattr(drive_configuration, "ANSWER_S", 0.02)
    yield one
    one.close()


def started(arm):
    arm.connect()
    assert until(lambda: arm.health().ok)
    arm.activate()
    return arm.buses[-1]


def underway(arm):
    """Joint 1 at 40 mm/s or more."""
    q = arm.position()
    q[0] += 0.1 if q[0] < 0.0 else -0.1
    arm.move(q)
    assert until(lambda: abs(arm.servos[0].speed) > 4e4)


def test_drives_that_stand_outside_their_limits_are_not_enabled(arm):
    arm.servos[1].position = 0.0
    arm.connect()
    assert until(lambda: arm.health().ok)
    with pytest.raises(
        DriverError, match=r"q2 \(drive 2\) reports 0 rad.*1\.658 .*home the drives"
    ):
        arm.activate()
    assert arm.buses[-1].told == [] and arm.servos[1].position == 0.0
    arm.servos[1].position = 2.0 * arm.setting.counts_per_unit[1]
    assert until(lambda: arm.position()[1] == pytest.approx(2.0))
    arm.activate()
    assert arm.read().mode == "running"


def test_recover_stops_a_moving_robot_before_it_takes_the_voltage_off(arm):
    bus = started(arm)
    underway(arm)
    begun = time.monotonic()
    arm.recover(unlock=True)
    speeds = [v for v, _ in bus.voltage_off(begun)]
    assert speeds and max(speeds) < SLOW
    assert max(abs(v) for _, word, v, t in bus.told if word == 0x02) > 3e4
    assert until(lambda: arm.read().mode == "running") and arm.health().ok


def test_a_drive_that_stops_by_itself_keeps_its_voltage_on_its_ramp(arm, monkeypatch):
    bus = started(arm)
    underway(arm)
    monkeypatch.setattr(arm._cycle, "_evaluate", lambda: None)  # it happens after the judgement
    begun = time.monotonic()
    arm.servos[0].state = 0x07
    assert until(lambda: arm._cycle.drives[0].sent == 0x02)
    time.sleep(5 * T)
    assert bus.voltage_off(begun) == []


def test_drives_that_still_move_are_not_enabled(arm):
    arm.connect()
    assert until(lambda: arm.health().ok and arm._cycle.answers.sequence > 10)
    arm.servos[3].speed = 8e4  # rolls out by itself, in 0.27 s
    begun = time.monotonic()
    assert until(lambda: abs(arm.read().qd[3]) > 0.1)
    arm.activate()
    assert min(t for *_, t in arm.buses[-1].told) > begun + 0.15


@pytest.mark.sampled
@pytest.mark.parametrize("kind, seconds", [("soft", 0.2), ("hard", 0.9), ("hard", np.inf)])
def test_deactivate_waits_for_the_ramp_too(arm, kind, seconds):
    bus = started(arm)
    arm.servos[0].stops_in = seconds
    underway(arm)
    if kind == "hard":
        arm.stop("hard")
    begun = time.monotonic()
    arm.deactivate()
    speeds = [v for v, _ in bus.voltage_off(begun)]
    assert bool(speeds) == (seconds < np.inf)  # one that does not stop keeps its voltage
    assert max(speeds, default=0.0) < SLOW


def test_drives_that_are_silent_are_given_the_time_to_stop_by_themselves(arm):
    bus = started(arm)
    underway(arm)
    bus.silent = True
    begun = time.monotonic()
    with pytest.raises(DriverError):
        arm.recover(unlock=True)
    first = min(t for _, t in bus.voltage_off(begun))
    assert first - begun > arm.setting.watchdog + cycle.REST_S - 2 * T


def test_an_axis_that_does_not_stop_keeps_its_voltage(arm):
    bus = started(arm)
    arm.servos[0].stops_in = np.inf
    underway(arm)
    begun = time.monotonic()
    with pytest.raises(DriverError, match="drive 1 still moves .* emergency stop"):
        arm.recover(unlock=True)
    assert bus.voltage_off(begun) == []


def test_recover_may_fail_and_be_called_again(arm):
    started(arm).dead = "cut"
    assert until(lambda: arm.health().state == "lost")
    arm.servos[2].mute = True
    for _ in range(2):
        with pytest.raises(LinkError, match="drive 3"):
            arm.recover(unlock=True)
        assert arm.health().state == "lost" and arm.buses[-1].dead
    arm.servos[2].mute = False
    arm.transducer.broken = True
    for _ in range(2):
        with pytest.raises(LinkError, match="no board"):
            arm.recover(unlock=True)
    arm.transducer.broken = False
    arm.recover(unlock=True)
    assert until(lambda: arm.health().ok) and arm.transducer.open
    underway(arm)


@pytest.mark.parametrize("lost, ready", [(1, True), (2, True), (3, False)])
def test_a_command_that_a_drive_did_not_hear_is_sent_again(arm, lost, ready):
    for servo in arm.servos:
        servo.running = True
    arm.servos[4].lost = lost
    refused = pytest.raises(DriverError, match="drive 5, object 0x1400:1: refused with 0x08000022")
    with nullcontext() if ready else refused:
        arm.connect()
    assert arm.servos[4].running is True and (arm.health().state != "closed") is ready


def test_recovery_does_not_count_on_a_cycle_that_is_about_to_end(arm, monkeypatch):
    started(arm)
    bus, send = arm._link, arm._link.send

    def slow(*frame):
        send(*frame)
        time.sleep(0.05 if arm._cycle.latched else 0.0)

    monkeypatch.setattr(bus, "send", slow)
    monkeypatch.setattr(arm._cycle, "_evaluate", lambda: 1 / 0)
    assert until(lambda: arm.health().state == "lost")
    arm.recover(unlock=True)
    assert until(lambda: arm.health().ok)


def test_a_cycle_that_breaks_off_is_named_and_recovered_from(arm, monkeypatch):
    bus = started(arm)
    underway(arm)

    def odd():
        raise ValueError("cannot convert\nNaN")

    monkeypatch.setattr(arm._setpoints, "step", odd)
    assert until(lambda: arm.health().state == "lost")
    assert "ValueError: cannot convert NaN" in arm.health().detail
    assert [word for _, word, _, _ in bus.told[-6:]] == [0x02] * 6
    arm.recover(unlock=True)
    assert len(arm.buses) == 2 and until(lambda: arm.health().ok)


def test_what_stops_a_drive_without_master_is_set_where_it_has_it(arm):
    for servo in arm.servos[:4]:
        servo.objects |= GUARDS
    arm.servos[0].objects[0x605A, 0] = 2
    started(arm)
    for servo in arm.servos[:4]:
        assert servo.objects[0x1400, 5] == 50 and servo.objects[0x6007, 0] == 3
        assert servo.objects[0x1016, 1] == (BEAT - 0x700) << 16 | 350
        assert servo.objects[0x1029, 1] == 0
    assert [servo.objects[0x605A, 0] for servo in arm.servos[:2]] == [2, 6]
    counters = arm.health().counters
    for index in ("0x6007", "0x605A", "0x1016", "0x1029"):
        assert counters[f"arm without {index}"] == 2.0
    arm.close()
    assert {servo.objects[0x1016, 1] for servo in arm.servos[:4]} == {0}


@pytest.mark.parametrize("taken", [0, 5000, None])
def test_a_drive_without_deadline_for_targets_is_not_enabled(arm, taken):
    if taken is None:
        del arm.servos[4].objects[0x1400, 5]
    else:
        arm.servos[4].stubborn[0x1400, 5] = taken
    arm.connect()
    assert until(lambda: arm.health().ok) and arm.position().shape == (6,)
    with pytest.raises(DriverError, match="drive 5, object 0x1400:5.*stop by itself"):
        arm.activate()
    assert arm.buses[-1].told == []


def test_the_master_beats(arm):
    bus = started(arm)
    begun, beats = time.monotonic(), bus.beats
    time.sleep(0.25)
    passed = time.monotonic() - begun
    assert bus.beats - beats == pytest.approx(passed / HEARTBEAT_S, abs=2.5)


def test_the_masters_id_is_nobody_elses():
    assert options.master(0x68, (1, 2, 3)) == 127
    assert options.master(0x68, (127, 126)) == 125
    assert options.master(0x77, (1, 2)) == 0x6F
