"""Progress stays off what is not a terminal."""

from wrenchbed.cli import console


def test_a_bar_without_a_terminal_is_silent(capsys):
    with console.progress("work", 3) as report:
        report(1, "first")
    assert capsys.readouterr() == ("", "")
