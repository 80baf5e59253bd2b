"""Names of files: their natural order, and the values that stand in them."""

import re
from pathlib import Path

from wrenchbed.errors import MapError

_VALUE = re.compile(r"\{(\w+)\}")
_NUMBER = r"([+-]?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)"


def natural(path: Path) -> list[tuple[int, str]]:
    """Key of an order in which pose_2 comes before pose_10."""
    return [(int(p), "") if p.isdecimal() else (-1, p) for p in re.split(r"(\d+)", path.name)]


def values_in_name(path: Path, pattern: str | None) -> dict[str, float]:
    """Values that stand in a file's name.

    Raises:
        MapError: the name does not fit the pattern.
    """
    if pattern is None:
        return {}
    pieces = _VALUE.split(pattern)
    text = "".join(_NUMBER if k % 2 else re.escape(p) for k, p in enumerate(pieces))
    found = re.fullmatch(text.replace(r"\*", ".*"), path.name) or re.fullmatch(
        text.replace(r"\*", ".*"), path.stem
    )
    if found is None:
        raise MapError(f"{path}: the name does not fit name_pattern = {pattern!r}")
    return {name: float(v) for name, v in zip(pieces[1::2], found.groups(), strict=True)}
