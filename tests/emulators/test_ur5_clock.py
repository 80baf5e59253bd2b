"""What the UR5's emulator is told before it serves, and what it does when it comes late."""

import itertools
from unittest.mock import Mock

import numpy as np
import pytest

from robot_emulators.base import real_time as clock_module
from robot_emulators.base.real_time import GIVE_UP_S, CycleClock
from robot_emulators.errors import SettingError
from robot_emulators.ur import outputs, server
from robot_emulators.ur.dashboard import Dashboard
from robot_emulators.ur.settings import MODELS
from wrenchbed.plant.serving import EmulatorOptions, emulated

PERIOD = 0.008


class Hands:
    """A clock that stands until it is moved [s]."""

    def __init__(self) -> None:
        self.now = 1000.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def hands(monkeypatch):
    hands = Hands()
    for module in (clock_module, server, outputs):
        monkeypatch.setattr(module, "time", hands)
    return hands


def test_deadlines_do_not_drift(hands):
    clock = CycleClock(PERIOD)
    for k in range(1, 100):
        assert clock.due == pytest.approx(1000.0 + k * PERIOD)
        hands.now = clock.due + 0.3 * PERIOD
        assert clock.remaining == 0.0
        assert clock.advance() == 0
    assert clock.lost == 0.0


def test_deadlines_that_were_missed_come_at_once(hands):
    clock = CycleClock(PERIOD)
    hands.now += 10.5 * PERIOD
    behind = []
    while clock.remaining == 0.0:
        behind.append(clock.advance())
    assert behind == [9, 8, 7, 6, 5, 4, 3, 2, 1, 0] and clock.lost == 0.0
    assert clock.remaining == pytest.approx(0.5 * PERIOD)


@pytest.mark.parametrize("late", [0.99 * GIVE_UP_S, 60.0])
def test_a_clock_that_is_very_late_gives_the_rest_up_and_says_how_much(hands, late):
    clock = CycleClock(PERIOD)
    hands.now += PERIOD + late
    behind = clock.advance()
    if late < GIVE_UP_S:
        assert behind == int(late / PERIOD) and clock.lost == 0.0
        return
    assert behind == 0 and clock.lost == pytest.approx(late)
    assert clock.remaining == pytest.approx(PERIOD)
    hands.now += PERIOD
    assert clock.advance() == 0 and clock.lost == pytest.approx(late)


@pytest.fixture
def emulator():
    return emulated("ur5", EmulatorOptions("127.0.1.35", noise="off", setting={"box": "off"}))


def test_the_time_stamp_counts_the_time_in_which_the_loop_stood_still(hands, emulator, monkeypatch):
    """As much as the clock gave up: afterwards both have gone on as far as real time."""
    seen = []

    def cycle(behind):
        seen.append((behind, emulator.timestamp.now() - first))
        emulator.plant.step(emulator.plant.target)

    monkeypatch.setattr(emulator, "_cycle", cycle)
    monkeypatch.setattr(emulator, "_wait", lambda pause=0.0: None)
    for _ in range(4):  # until the state that is shown moves on with each cycle
        emulator.plant.step(emulator.plant.target)
    first = emulator.timestamp.now()
    emulator._begin()
    for turn in range(8):
        hands.now += PERIOD if turn != 5 else 3.0 + PERIOD
        emulator._turn()
    assert [behind for behind, _ in seen] == [0] * 8
    steps = [b - a for (_, a), (_, b) in itertools.pairwise(seen)]
    assert steps[:4] == pytest.approx([PERIOD] * 4)
    assert steps[4] == pytest.approx(3.0, abs=0.02)
    assert steps[5:] == pytest.approx([PERIOD] * 2)


def test_packets_are_left_out_while_the_loop_is_late(hands, emulator, monkeypatch):
    """None while it catches up, and one in some cycles where it stays late."""
    sent = []
    monkeypatch.setattr(emulator.rtde, "stream", lambda values, send: sent.append(send))
    late = int(server._LATE_S / PERIOD) + 1
    for behind in range(late + 20, 0, -1):
        hands.now += 0.001
        emulator._cycle(behind)
    assert sum(sent[1:21]) == 0 and all(sent[22:])
    sent.clear()
    for _ in range(100):
        hands.now += 1.01 * PERIOD
        emulator._cycle(50)
    assert sum(sent) == pytest.approx(100 / server._SHARE, abs=1)


@pytest.mark.parametrize(
    "setting, why",
    [
        ({"series": "cb4"}, "one of cb3, e, x"),
        ({"software": "5.23"}, "three numbers"),
        ({"software": "5.23.0"}, "not of series cb3"),
        ({"programs": "no such folder"}, "no such folder"),
        ({"external_control": "pc:50002"}, "IPv4"),
        ({"speed": "1"}, "series"),
        ({"protective_force": "-1"}, "above 0"),
        ({"box": "maybe"}, "on or off"),
        ({"buffer": "0"}, "1 … 40"),
        ({"model": "ur7"}, "one of ur3, ur5, ur10, ur3e, .*, ur8long, ur15, ur18, ur20, ur30"),
        ({"model": "ur10e", "series": "cb3"}, "never had a CB3 controller"),
    ],
)
def test_settings_are_checked(setting, why):
    with pytest.raises(SettingError, match=why):
        emulated("ur5", EmulatorOptions("127.0.1.32", setting=setting))


@pytest.mark.parametrize("model", MODELS)
def test_the_controller_is_that_of_its_arm(model):
    """Its poses are those of the published table, its body is that arm, its series fits."""
    emulator = emulated(
        "ur5", EmulatorOptions("127.0.1.32", setting={"model": model, "box": "off"})
    )
    controller, body = emulator.controller, emulator.plant
    assert body.robot.name == model
    assert controller.settings.e_series == (model not in ("ur3", "ur5", "ur10"))
    q = body.robot.home + 0.1
    rotation, position = controller.arm.kinematics.flange(q)
    wanted, place = body.robot.flange_pose(q[None], body.robot.parameters.nominal)
    assert np.abs(position - place[0]).max() < 1e-12
    assert np.abs(rotation - wanted[0]).max() < 1e-12
    pose = controller.arm.kinematics.pose(q, np.zeros(6))
    assert np.abs(controller.arm.kinematics.inverse(pose, np.zeros(6), q) - q).max() < 1e-9
    said = Dashboard(controller, Mock(), lambda: None)._answer("get robot model")
    assert said == {"ur7e": "UR5", "ur12e": "UR10"}.get(model, model.upper().removesuffix("E"))
