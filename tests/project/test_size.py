"""Budgets of lines. A change that needs more gives something up first (see CONTRIBUTING)."""

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
WRENCHBED = {
    ".": 658,
    "benchmark": 10147,
    "calibration": 5120,
    "campaigns": 1667,
    "cli": 2903,
    "data": 4818,
    "diagnosis": 13710,
    "drives": 972,
    "effects": 4304,
    "environments": 755,
    "exports": 1049,
    "files": 549,
    "hardware": 7587,
    "jobs": 465,
    "monitoring": 1656,
    "pages": 1195,
    "physics": 1130,
    "planning": 1199,
    "plant": 862,
    "reports": 2504,
    "robots": 5317,
    "sensors": 337,
    "simulation": 1398,
    "studies": 1637,
    "twin": 1064,
    "viewer": 1225,
}
"""Lines of Python of each room of wrenchbed at most; ``.`` is the package's own files."""
IN_ALL = {
    "src": 84440,
    "src/wrenchbed": 74228,
    "src/robot_emulators": 10212,
    "tests": 43083,
    "scripts": 3470,
}
"""Lines of Python below a folder at most; of scripts every line."""
MOST_FILES = 478
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
