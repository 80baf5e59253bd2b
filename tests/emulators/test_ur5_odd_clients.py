"""Odd clients of the UR5's emulator: a program or a peer ends, and the robot serves on."""

import time
import warnings
from math import inf, nan
from types import SimpleNamespace

import numpy as np
import pytest

from robot_emulators.errors import EmulatorError
from robot_emulators.ur.dashboard import Dashboard
from robot_emulators.ur.messages import FAULT
from robot_emulators.ur.modes import Runtime
from robot_emulators.ur.outputs import Outputs
from robot_emulators.ur.packets import Recipe
from robot_emulators.ur.urscript.tokens import Collector
from ur5_bench import CYCLE, Bench
from wrenchbed.plant.serving import EmulatorOptions, emulated

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
    assert fault.text and fault.place[0] == 1
    answers_and_packs(bench)


def test_a_dashboard_line_without_end_ends_its_connection(bench):
    said = []
    talk = Dashboard(bench.controller, SimpleNamespace(send=said.append), lambda: None)
    assert talk.receive(b"x" * 4000, 1.0)
    assert not talk.receive(b"x" * 4000, 1.0)
    assert len(said) == 1


@pytest.fixture
def broken(monkeypatch, capfd):
    """An emulator whose loop breaks down at once."""

    def cycle(now):
        raise ZeroDivisionError("a cycle that cannot be")

    emulator = emulated("ur5", EmulatorOptions(HOST, noise="off", setting={"box": "off"}))
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


def test_a_loop_that_hangs_refuses_faults_and_never_does_them(monkeypatch):
    monkeypatch.setattr("robot_emulators.ur.server._INJECT_S", 0.1)
    emulator = emulated("ur5", EmulatorOptions(HOST, noise="off", setting={"box": "off"}))
    done = []
    with pytest.raises(EmulatorError, match=r"has stopped.*0\.1 s"):
        emulator.soon(lambda: done.append(1))
    with emulator:
        emulator.soon(lambda: None)
        assert not done


def test_a_fault_that_fails_raises_where_it_was_injected():
    emulator = emulated("ur5", EmulatorOptions(HOST, noise="off", setting={"box": "off"}))

    def fail():
        raise KeyError("no such thing")

    with emulator:
        with pytest.raises(KeyError, match="no such thing"):
            emulator.soon(fail)
        assert not emulator.failed.is_set()


def test_a_stop_before_the_first_cycle_lasts_as_long_as_any(monkeypatch):
    emulator = emulated("ur5", EmulatorOptions(HOST, noise="off", setting={"box": "off"}))
    monkeypatch.setattr(emulator, "_wait", lambda: None)
    with emulator:
        emulator.controller.protective_stop()
        modes = emulator.controller.modes
        assert not modes.unlock()
        modes.tick(time.monotonic() + 5.1)
        assert modes.unlock()
