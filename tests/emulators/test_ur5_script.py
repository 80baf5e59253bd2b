"""URScript on its way to the UR5's emulator: programs put together, recognised and checked."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_emulators.ur.script import Collector, is_secondary
from ur5_bench import CYCLE, Bench


def program(*lines: str) -> bytes:
    return ("\n".join(lines) + "\n").encode()


def test_other_scripts_are_separate_programs():
    collector = Collector()
    scripts = collector.feed(
        program("# words", "", "stopj(2)", "sec s():", "  set_digital_out(0, True)", "end")
    )
    assert [is_secondary(text) for text in scripts] == [False, True]
    text = program("def f():", " write_output_integer_register(0 +24, 2)", "end")
    assert collector.feed(text) == [text.decode()]


@settings(max_examples=200, deadline=None)
@given(st.lists(st.binary(max_size=60), max_size=20))
def test_arbitrary_text_never_crashes_the_collector(chunks):
    collector = Collector()
    for chunk in chunks:
        assert collector.feed(chunk) is not None


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
