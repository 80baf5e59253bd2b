"""Budgets of lines. A change that needs more gives something up first (see CONTRIBUTING)."""

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
WRENCHBED = {
    ".": 618,
    "benchmark": 8610,
    "calibration": 5687,
    "campaigns": 1388,
    "channels": 985,
    "cli": 2761,
    "data": 5009,
    "diagnosis": 14238,
    "drives": 1802,
    "effects": 4952,
    "environments": 618,
    "exports": 849,
    "files": 607,
    "hardware": 6850,
    "jobs": 452,
    "monitoring": 1537,
    "pages": 1151,
    "physics": 1156,
    "planning": 1051,
    "plant": 835,
    "reports": 2178,
    "robots": 4788,
    "sensors": 330,
    "simulation": 1318,
    "studies": 1458,
    "twin": 1187,
    "viewer": 1098,
}
"""Lines of Python of each room of wrenchbed at most; ``.`` is the package's own files."""
IN_ALL = {
    "src": 82010,
    "src/wrenchbed": 72481,
    "src/robot_emulators": 9766,
    "tests": 42272,
    "scripts": 3520,
}
"""Lines of Python below a folder at most; of scripts every line."""
MOST_FILES = 491
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
