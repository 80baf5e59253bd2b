"""Budgets of lines. A change that needs more gives something up first (see CONTRIBUTING)."""

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
WRENCHBED = {
    ".": 618,
    "benchmark": 8016,
    "calibration": 5443,
    "campaigns": 1343,
    "channels": 933,
    "cli": 2761,
    "data": 5048,
    "diagnosis": 13861,
    "drives": 1695,
    "effects": 4953,
    "environments": 618,
    "exports": 848,
    "files": 607,
    "hardware": 6847,
    "jobs": 416,
    "monitoring": 1519,
    "pages": 1151,
    "physics": 1055,
    "planning": 1082,
    "plant": 805,
    "reports": 2188,
    "robots": 4776,
    "sensors": 330,
    "simulation": 1265,
    "studies": 1452,
    "twin": 1164,
    "viewer": 1098,
}
"""Lines of Python of each room of wrenchbed at most; ``.`` is the package's own files."""
IN_ALL = {
    "src": 81342,
    "src/wrenchbed": 71892,
    "src/robot_emulators": 9450,
    "tests": 40842,
    "scripts": 3499,
}
"""Lines of Python below a folder at most; of scripts every line."""
MOST_FILES = 489
"""Files of Python below src at most."""


def lines(*paths: Path) -> int:
    """Lines of files."""
    return sum(path.read_bytes().count(b"\n") for path in paths)


def test_every_room_has_a_budget():
    rooms = {
        p.name for p in (ROOT / "src" / "wrenchbed").iterdir() if (p / "__init__.py").is_file()
    }
    assert rooms | {"."} == set(WRENCHBED)


@pytest.mark.parametrize("room", WRENCHBED)
def test_a_room_keeps_to_its_budget(room):
    folder = ROOT / "src" / "wrenchbed" / room
    files = folder.glob("*.py") if room == "." else folder.rglob("*.py")
    assert lines(*files) <= WRENCHBED[room]


@pytest.mark.parametrize("folder", IN_ALL)
def test_a_package_keeps_to_its_budget(folder):
    pattern = "*" if folder == "scripts" else "*.py"
    files = [p for p in (ROOT / folder).rglob(pattern) if p.is_file() and p.suffix != ".pyc"]
    assert lines(*files) <= IN_ALL[folder]


def test_files_are_few():
    assert len(list((ROOT / "src").rglob("*.py"))) <= MOST_FILES
