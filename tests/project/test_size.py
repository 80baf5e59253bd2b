"""Budgets of lines. A change that needs more gives something up first (see CONTRIBUTING)."""

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
WRENCHBED = {
    ".": 805,
    "benchmark": 11435,
    "calibration": 4797,
    "campaigns": 1832,
    "cli": 3261,
    "data": 5484,
    "diagnosis": 13104,
    "drives": 972,
    "effects": 4364,
    "environments": 771,
    "exports": 1083,
    "files": 549,
    "hardware": 8370,
    "jobs": 465,
    "monitoring": 1827,
    "pages": 1315,
    "physics": 1180,
    "planning": 1237,
    "plant": 872,
    "reports": 2876,
    "robots": 5793,
    "sensors": 345,
    "simulation": 1479,
    "studies": 2596,
    "twin": 1157,
    "viewer": 1862,
}
"""Lines of Python of each room of wrenchbed at most; ``.`` is the package's own files."""
IN_ALL = {
    "src": 91235,
    "src/wrenchbed": 79831,
    "src/robot_emulators": 11404,
    "tests": 48744,
    "scripts": 3528,
}
"""Lines of Python below a folder at most; of scripts every line."""
MOST_FILES = 532
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
