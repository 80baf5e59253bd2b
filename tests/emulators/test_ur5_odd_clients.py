"""The UR5's emulator is served: what it is told before, odd clients, and a loop that comes late."""

import itertools
import time
import warnings
from math import inf, nan
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from robot_emulators.base import real_time as clock_module
from robot_emulators.base.real_time import GIVE_UP_S, CycleClock
from robot_emulators.errors import EmulatorError, SettingError
from robot_emulators.ur import outputs, server
from robot_emulators.ur.dashboard import Dashboard
from robot_emulators.ur.messages import FAULT
from robot_emulators.ur.modes import Runtime
from robot_emulators.ur.outputs import Outputs
from robot_emulators.ur.rtde_packets import Recipe
from robot_emulators.ur.settings import MODELS
from robot_emulators.ur.urscript.tokens import Collector
from unstarted import emulated
from ur5_bench import CYCLE, Bench
from wrenchbed.plant.serving import EmulatorOptions

HOST = "127.0.1.33"


@pytest.fixture(scope="module")
def bench():
    return Bench(series="e")


def answers_and_packs(bench: Bench) -> None:
    """All that it says can be sent, and a new program works."""
    controller = bench.controller
    outputs = Outputs(controller, shared=False)
    outputs.update(1.0, set(controller.fields))
    Recipe(1, list(controller.fields.items())).pack(controller.values)
    assert np.isfinite(controller.values["actual_TCP_pose"]).all()
    assert np.isfinite(controller.values["actual_TCP_force"]).all()
    assert np.isfinite(bench.arm.q).all()


@pytest.mark.parametrize(
    "number, at, odd", [(29, 4, inf), (3, 3, -inf), (1, 0, nan), (11, 2, 1e300), (17, 0, nan),
                        (59, 2, 1e300), (6, 7, inf)],
)  # fmt: skip
def test_such_a_command_ends_its_program(bench, number, at, odd):
    bench.controller.reboot()
    bench.script()
    bench.command(number, **{f"d{at}": odd})
    bench.run(2 * CYCLE)
    assert bench.controller.modes.runtime is Runtime.STOPPED
    answers_and_packs(bench)
    bench.write(i0=0, **{f"d{at}": 0.0})
    bench.script()
    assert bench.controller.modes.runtime is Runtime.PLAYING


def test_a_tool_that_is_far_away_stops_the_arm_at_most(bench):
    bench.controller.reboot()
    bench.script()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        for command in (10, 41, 24, 3, 43):
            bench.command(29, *[1e6] * 6)
            bench.run(2 * CYCLE)
            bench.command(command, *[0.1] * 6, 0.5, 0.5)
            bench.run(5 * CYCLE)
            answers_and_packs(bench)
            bench.controller.reboot()
            bench.script()


@pytest.mark.parametrize(
    "text",
    [
        b"write_output_integer_register(0 +0, 99999999999)\n",
        b"write_output_integer_register(0 +0, -2147483649)\n",
        b"write_output_integer_register(0 +" + b"1" * 5000 + b", 1)\n",
        b"set_gravity([0, 0, 1e300])\n",
        b"set_tcp(p[0, 0, 1e9, 0, 0, 0])\n",
        b"movej([1, 2, 3])\n",
        b"x = read_input_integer_register(48)\n",
        b"x = read_input_integer_register(-5)\n",
        b"x = " + b"(" * 5000 + b"\n",
    ],
    ids=range(9),
)
def test_an_interpreted_script_with_impossible_values_ends_with_its_reason(bench, text):
    bench.controller.reboot()
    said = []
    bench.controller.announce = said.append
    bench.controller.upload(Collector().feed(text))
    deadline = time.monotonic() + 10.0
    while time.monotonic() < deadline and not any(event.kind == FAULT for event in said):
        bench.run(2 * CYCLE)  # a long program is compiled in another thread, in real time
    bench.controller.announce = lambda event: None
    assert bench.controller.modes.runtime is Runtime.STOPPED and bench.controller.program is None
    (fault,) = [event for event in said if event.kind == FAULT]
    assert fault.text and fault.fields[:4] == bytes([0, 0, 0, 1])  # line 1
    answers_and_packs(bench)


def test_a_dashboard_line_without_end_ends_its_connection(bench):
    said = []
    talk = Dashboard(bench.controller, SimpleNamespace(send=said.append), lambda: None)
    assert talk.receive(b"x" * 4000, 1.0)
    assert not talk.receive(b"x" * 4000, 1.0)
    assert len(said) == 1


@pytest.mark.parametrize("remote", [True, False])
def test_whether_it_is_in_remote_control_is_a_setting(remote):
    said = []
    controller = Bench(series="e", remote=remote).controller
    Dashboard(controller, SimpleNamespace(send=said.append), lambda: None).receive(
        b"is in remote control\n", 1.0
    )
    assert said[1] == str(remote).lower().encode() + b"\n"


@pytest.fixture
def emulator():
    return emulated("ur5", EmulatorOptions(HOST, noise="off", setting={"box": "off"}))


@pytest.fixture
def broken(emulator, monkeypatch, capfd):
    """An emulator whose loop breaks down at once."""

    def cycle(now):
        raise ZeroDivisionError("a cycle that cannot be")

    monkeypatch.setattr(emulator.controller, "cycle", cycle)
    with emulator:
        assert emulator.failed.wait(3.0)
        yield emulator
    assert "a cycle that cannot be" in capfd.readouterr().err


def test_a_loop_that_breaks_down_says_so_and_refuses_faults(broken):
    assert isinstance(broken.failure, ZeroDivisionError)
    begun = time.monotonic()
    with pytest.raises(EmulatorError, match="a cycle that cannot be"):
        broken.soon(lambda: None)
    assert time.monotonic() - begun < 1.0


def test_a_loop_that_hangs_refuses_faults_and_never_does_them(emulator, monkeypatch):
    monkeypatch.setattr("robot_emulators.ur.server._INJECT_S", 0.1)
    done = []
    with pytest.raises(EmulatorError, match=r"has stopped.*0\.1 s"):
        emulator.soon(lambda: done.append(1))
    with emulator:
        emulator.soon(lambda: None)
        assert not done


def test_a_fault_that_fails_raises_where_it_was_injected(emulator):
    def fail():
        raise KeyError("no such thing")

    with emulator:
        with pytest.raises(KeyError, match="no such thing"):
            emulator.soon(fail)
        assert not emulator.failed.is_set()


def test_a_stop_before_the_first_cycle_lasts_as_long_as_any(emulator, monkeypatch):
    monkeypatch.setattr(emulator, "_wait", lambda: None)
    with emulator:
        emulator.controller.protective_stop()
        modes = emulator.controller.modes
        assert not modes.unlock()
        modes.tick(time.monotonic() + 5.1)
        assert modes.unlock()


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


def test_deadlines_do_not_drift_and_missed_ones_come_at_once(hands):
    clock = CycleClock(PERIOD)
    for k in range(1, 100):
        assert clock.due == pytest.approx(1000.0 + k * PERIOD)
        hands.now = clock.due + 0.3 * PERIOD
        assert clock.remaining == 0.0
        assert clock.advance() == 0
    assert clock.lost == 0.0
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


def test_the_time_stamp_counts_the_time_in_which_the_loop_stood_still(hands, emulator, monkeypatch):
    """As much as the clock gave up: afterwards both have gone on as far as real time."""
    seen = []

    def cycle():
        seen.append(emulator.timestamp.now() - first)
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
    steps = [b - a for a, b in itertools.pairwise(seen)]
    assert steps[:4] == pytest.approx([PERIOD] * 4)
    assert steps[4] == pytest.approx(3.0, abs=0.02)
    assert steps[5:] == pytest.approx([PERIOD] * 2)


def test_states_are_sent_however_late_the_loop_is(hands, emulator, monkeypatch):
    sent = []
    monkeypatch.setattr(emulator.rtde, "stream", sent.append)
    monkeypatch.setattr(emulator, "_wait", lambda pause=0.0: None)
    emulator._begin()
    for _ in range(100):
        hands.now += PERIOD if len(sent) != 20 else 0.9
        emulator._turn()
    assert len(sent) == 100


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
        ({"model": "ur7"}, "one of ur3, ur5, ur10, ur3e, .*, ur8long, ur15, ur18, ur20, ur30"),
        ({"model": "ur10e", "series": "cb3"}, "never had a CB3 controller"),
    ],
)
def test_settings_are_checked(setting, why):
    with pytest.raises(SettingError, match=why):
        emulated("ur5", EmulatorOptions("127.0.1.32", setting=setting))


@pytest.mark.sampled
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
