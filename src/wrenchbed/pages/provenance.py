"""Where a page or a picture comes from: date, data by their SHA-256, version, seed, command."""

import hashlib
import os
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

NO_FILE = "unknown: there is no such file here"
Facts = Sequence[tuple[str, str]]
"""Label and text of each."""


def provenance(
    files: Sequence[str | Path], command: str = "", seed: int | None = None
) -> list[tuple[str, str]]:
    """Label and text of each fact.

    Args:
        files: paths of what was read; names of data that are in no file are told as such.
        command: that made it; left out if empty.
        seed: of all random choices; left out if there were none.
    """
    lines = [(f"SHA-256 of {Path(r).name}", sha256(r) or NO_FILE) for r in files]
    lines += [("made", f"{_now():%Y-%m-%d %H:%M} UTC by wrenchbed {version('wrenchbed')}")]
    lines += [("seed", str(seed))] if seed is not None else []
    return lines + ([("command", command)] if command else [])


def sha256(path: str | Path) -> str:
    """Of a file's bytes, empty if there is no such file."""
    try:
        with Path(path).open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except (OSError, ValueError):
        return ""


def markdown(lines: Facts) -> list[str]:
    """The facts as lines of Markdown."""
    return ["", "**Data and command**", "", *(f"- {label}: {text}" for label, text in lines)]


def _now() -> datetime:
    """The time, or that of SOURCE_DATE_EPOCH [s since 1970] where builds are to be repeatable."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    return datetime.fromtimestamp(int(epoch), UTC) if epoch.isdigit() else datetime.now(UTC)
