"""Progress: the time that remains is that of the mean rate, whatever was done before."""

import pytest

from wrenchbed.cli import console


@pytest.mark.parametrize(
    ("reports", "said"),
    [
        ([(0.5, 0)], "-:--:--"),
        ([(10.0, 1), (20.0, 2)], "0:01:20"),  # 8 of 10 steps at 10 s
        ([(0.1, 6)], "-:--:--"),  # of an earlier run
        ([(0.1, 6), (40.1, 8)], "0:00:40"),
        ([(50.0, 1), (51.0, 5)], "0:00:51"),  # in bursts
        ([(7200.0, 5)], "2:00:00"),
        ([(100.0, 10)], "0:00:00"),
    ],
    ids=str,
)
def test_the_remaining_time_is_that_of_the_mean_rate(reports, said):
    column = console.RemainingColumn()
    texts = [column.text(elapsed, done, 10) for elapsed, done in reports]
    assert texts[-1] == said


def test_the_remaining_time_stays_while_a_step_lasts():
    column = console.RemainingColumn()
    texts = [column.text(t, done, 10) for t, done in [(10.0, 1), (20.0, 2), (25.0, 2), (29.9, 2)]]
    assert texts[1:] == ["0:01:20"] * 3


def test_work_that_begins_again_has_its_time_again():
    column = console.RemainingColumn()
    reports = [(10.0, 1), (20.0, 2), (80.0, 8), (90.0, 0), (100.0, 1), (110.0, 2)]
    texts = [column.text(elapsed, done, 10) for elapsed, done in reports]
    assert texts[2] == "0:00:20" and texts[-1] == "0:01:20"


def test_without_a_total_nothing_remains():
    assert console.RemainingColumn().text(5.0, 3, None) == "-:--:--"


def test_a_bar_without_a_terminal_is_silent(capsys):
    with console.progress("work", 3) as report:
        report(1, "first")
    assert capsys.readouterr() == ("", "")
