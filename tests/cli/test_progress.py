"""Progress: the time that remains is that of the mean rate, whatever was done before."""

import numpy as np
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
    texts = [column.text(0, elapsed, done, 10) for elapsed, done in reports]
    assert texts[-1] == said


def test_the_remaining_time_never_rises_while_a_step_lasts():
    """100 look-alikes of 4 s on two cores that load for 4.7 s first: 204.7 s, looked at often."""
    ends = [4.7 + 4.0 * (k // 2 + 1) + 0.1 * (k % 2) for k in range(100)]
    column, shown = console.RemainingColumn(), []
    for elapsed in np.arange(0.0, ends[-1], 0.1):
        done = sum(end <= elapsed for end in ends)
        shown.append((elapsed, column.text(0, elapsed, done, 100)))
    known = [(t, seconds(text)) for t, text in shown if text != "-:--:--"]
    assert known[0][0] < 10.0  # from the second step on
    assert np.diff([left for _, left in known]).max() <= 0
    true = [ends[-1] - t for t, _ in known]
    errors = [abs(left - rest) for (t, left), rest in zip(known, true, strict=True) if t > 60.0]
    assert max(errors) < 0.1 * 200.0


def test_steps_that_become_slower_hold_the_remaining_time():
    """5 steps of 1 s, then 5 of 10 s: 55 s in all."""
    column = console.RemainingColumn()
    ends = [1.0, 2.0, 3.0, 4.0, 5.0, 15.0, 25.0, 35.0, 45.0, 55.0]
    times = np.arange(0.0, 54.9, 0.1)
    texts = [column.text(0, t, sum(end <= t for end in ends), 10) for t in times]
    left = [seconds(text) for text in texts if text != "-:--:--"]
    assert np.diff(left).max() <= 0
    assert min(left[:-100]) > 0  # nothing is called done before its last step


def seconds(text):
    hours, minutes, rest = map(int, text.split(":"))
    return 3600 * hours + 60 * minutes + rest


def test_work_that_begins_again_has_its_time_again():
    column = console.RemainingColumn()
    reports = [(10.0, 1), (20.0, 2), (80.0, 8), (90.0, 0), (100.0, 1), (110.0, 2)]
    texts = [column.text(0, elapsed, done, 10) for elapsed, done in reports]
    assert texts[2] == "0:00:20" and texts[-1] == "0:01:20"


def test_without_a_total_nothing_remains():
    assert console.RemainingColumn().text(0, 5.0, 3, None) == "-:--:--"


def test_a_bar_without_a_terminal_is_silent(capsys):
    with console.progress("work", 3) as report:
        report(1, "first")
    assert capsys.readouterr() == ("", "")
