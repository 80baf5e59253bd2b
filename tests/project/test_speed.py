"""How `scripts/bench --check` compares speeds with those recorded."""

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def bench():
    sys.path.insert(0, str(ROOT / "scripts"))
    try:
        import bench_ratios
    finally:
        sys.path.remove(str(ROOT / "scripts"))
    return bench_ratios


def test_the_last_three_runs_on_such_a_processor_count(bench):
    def recorded(cpu, *runs):
        entries = [{"machine": {"cpu": c}, "ratios": {"a": ratio}} for ratio, c in runs]
        return bench.recorded(entries, cpu)

    runs = [(2.5, "x"), (3.3, "x"), (2.8, "x"), (70.0, "y"), (3.0, "x")]
    assert recorded("x", *runs) == {"a": 3.0}
    assert recorded("y", *runs) == {"a": 70.0}
    assert recorded("z", *runs) == {}
    assert recorded("x", *runs, (1.0, "x")) == {"a": 1.0}  # after a gain, and after a loss
    assert recorded("x", *runs, (9.0, "x")) == {"a": 9.0}


def test_the_page_is_that_of_the_history(bench):
    entries = bench.history()
    assert bench.PAGE.read_text(encoding="utf-8") == bench.page(entries)
