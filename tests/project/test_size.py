"""Budgets of lines. A change that needs more gives something up first (see CONTRIBUTING)."""

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
WRENCHBED = {
    ".": 537,
    "benchmark": 7904,
    "calibration": 5114,
    "campaigns": 1145,
    "channels": 979,
    "cli": 2727,
    "data": 5523,
    "diagnosis": 13289,
    "drives": 1799,
    "effects": 4952,
    "environments": 588,
    "exports": 828,
    "files": 576,
    "hardware": 6669,
    "jobs": 556,
    "monitoring": 1408,
    "pages": 1244,
    "physics": 1066,
    "planning": 916,
    "plant": 761,
    "reports": 2118,
    "robots": 4360,
    "sensors": 296,
    "simulation": 1341,
    "studies": 1322,
    "twin": 1077,
    "viewer": 789,
}
"""Lines of Python of each room of wrenchbed at most; ``.`` is the package's own files."""
IN_ALL = {
    "src": 79373,
    "src/wrenchbed": 69884,
    "src/robot_emulators": 9489,
    "tests": 38571,
    "scripts": 3496,
}
"""Lines of Python below a folder at most; of scripts every line."""
MOST_FILES = 466
"""Files of Python below src at most."""


def lines(*paths: Path) -> int:
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
