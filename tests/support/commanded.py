"""What a command said and left behind."""

from pathlib import Path


def names(folder: Path) -> list[str]:
    return [p.name for p in folder.iterdir()]


def said(capfd) -> str:
    captured = capfd.readouterr()
    lines = [line for line in captured.err.splitlines() if line]
    assert len(lines) == 1, captured.err
    assert lines[0].startswith("wrenchbed: error: ")
    return lines[0]
