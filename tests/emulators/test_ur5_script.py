"""URScript on its way to the UR5's emulator: programs put together, recognised and checked."""

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_emulators.ur.script import Collector
from ur5_bench import CYCLE, Bench


def program(*lines: str) -> bytes:
    return ("\n".join(lines) + "\n").encode()


CONTROL = (
    "def rtde_control():",
    "  global reg_offset_int = # int register offset",
    "24  global x = 1",
    "  def exec_move_path():",
    "    # inject move path",
    "\tsignal_async_progress(0)",
    "\tmovej([0,1,2,3,4,5],a=1.4,v=1.05,r=0.02)",
    "\tsignal_async_progress(1)",
    "\tmovel(p[0.1,0.2,0.3,0,3,0],a=1.2,v=0.25,r=0)",
    "  end",
    "  def signal_done_with_cmd():",
    "  end",
    "  def rtde_cmd():",
    "    if x == 1:",
    "      end_force_mode()",
    "    elif x == 2:",
    "      x = 3",
    "    end",
    "  end",
)


def test_the_control_script_is_recognised_with_its_offset_and_path():
    collector = Collector()
    assert collector.feed(program(*CONTROL)) == []
    (script,) = collector.feed(b"end\n")
    assert script.control and script.offset == 24
    joints, line = script.path
    assert not joints.straight and list(joints.goal) == [0, 1, 2, 3, 4, 5]
    assert (joints.speed, joints.acceleration) == (1.05, 1.4)
    assert line.straight and line.cartesian and line.speed == 0.25
    assert collector.held == 0


def test_other_scripts_are_separate_programs():
    collector = Collector()
    scripts = collector.feed(
        program("# words", "", "stopj(2)", "sec s():", "  set_digital_out(0, True)", "end")
    )
    assert [s.secondary for s in scripts] == [False, True]
    assert not any(s.control for s in scripts)
    text = program("def f():", " write_output_integer_register(0 +24, 2)", "end")
    assert collector.feed(text)[0].text == text.decode()


@settings(max_examples=200, deadline=None)
@given(st.lists(st.binary(max_size=60), max_size=20))
def test_arbitrary_text_never_crashes_the_collector(chunks):
    collector = Collector()
    for chunk in chunks:
        assert collector.feed(chunk) is not None


NUMBERS = st.sampled_from(
    ["0", "-1.5", "1e-3", "1e999", "nan", "inf", "--", "1.2.3", "e", "", " 2 ", "x", "9" * 400]
) | st.floats().map(str)
MOVES = st.builds(
    "{}({}[{}],a={},v={},r=0)".format,
    st.sampled_from(["movej", "movel", "movep"]), st.sampled_from(["", "p"]),
    st.lists(NUMBERS, min_size=5, max_size=7).map(",".join), NUMBERS, NUMBERS,
)  # fmt: skip
POSSIBLE = st.builds(
    "movej([{}],a=1,v=1,r=0)".format,
    st.lists(st.floats(-1e6, 1e6).map(str), min_size=6, max_size=6).map(",".join),
)


@settings(max_examples=400, deadline=None)
@given(
    st.lists(MOVES | POSSIBLE | st.text("mov(,]=a1", max_size=20), max_size=4),
    st.integers(0, 10**12).map(str) | st.just("9" * 5000),
)
def test_a_path_holds_what_an_arm_can_do_or_the_script_is_faulty(moves, offset):
    lines = [*CONTROL[:5], *moves, *CONTROL[9:], "end"]
    lines[2] = offset
    (script,) = [s for s in Collector().feed(program(*lines)) if s.control or s.faulty]
    known = list(itertools.takewhile(lambda m: m.startswith("mov") and "],a=" in m, moves))
    assert script.faulty or len(script.path) <= len(known)
    for leg in script.path:
        assert leg.goal.shape == (6,) and (abs(leg.goal) <= 1e6).all()
        assert abs(leg.speed) <= 1e6 and abs(leg.acceleration) <= 1e6


@settings(max_examples=50, deadline=None)
@given(st.lists(POSSIBLE, max_size=4))
def test_possible_moves_are_all_taken(moves):
    (script,) = Collector().feed(program(*CONTROL[:5], *moves, *CONTROL[9:], "end"))
    assert script.control and not script.faulty and len(script.path) == len(moves)


@pytest.fixture(scope="module")
def bench():
    return Bench()


@settings(max_examples=200, deadline=None)
@given(st.integers(-(10**12), 10**12) | st.sampled_from([2**31, 2**31 - 1, -(2**31) - 1]))
def test_only_what_fits_a_register_is_written(bench, value):
    bench.controller.values["output_int_register_3"] = (-7,)
    text = program("def f():", f" write_output_integer_register(0 +3, {value})", "end")
    bench.controller.upload(Collector().feed(text))
    bench.run(2 * CYCLE)
    assert bench.said(3) == (value if -(2**31) <= value < 2**31 else -7)


def test_an_endless_program_is_refused():
    collector = Collector()
    collector.feed(b"def f():\n")
    assert any(collector.feed(b"x = 1\n" * 20000) is None for _ in range(60))
