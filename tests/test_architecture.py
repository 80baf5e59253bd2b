"""The layers hold: who may import whom, who may print, and how long a file may be."""

import ast
import sys
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[1] / "src" / "wrenchbed"
LAYERS = {
    "errors": 0, "health": 1, "device": 1.1,
    "registry": 1, "parameters": 1, "jets": 1, "frames": 1.1, "noise": 1,
    "wrench": 2, "identify": 2.1, "parquet": 1, "points": 1,
    "metadata": 2.1, "recording": 2.2, "writer": 2.3,
    "plan": 2.3, "holds": 2.3, "column_map": 2.2, "logs": 2.3,
    "importing": 2.4, "mjcf": 2.1, "sensors": 2,
    "gravity": 2.1, "robots": 3, "turning": 3.1, "scene": 4, "effects": 4.1, "chain": 4.2,
    "lookalikes": 5.5,
    "springs": 2.1, "sensor_only": 4, "model": 5, "simulation": 5, "plant": 5.1, "assembly": 5.05,
    "mechanics": 5.1, "twin": 5.3, "typical": 5.3, "playback": 6.2, "exporting": 5.4,
    "observability": 6, "simulators": 6.3,
    "accuracy": 4, "touches": 6.15, "selection": 6.1,
    "gauss_newton": 6.1, "fit": 6.16, "observations": 6.1, "wander": 6.1,
    "problem": 6.2, "start": 6.2,
    "weighting": 6.3, "calibration": 7,
    "transducers": 7.5, "drivers": 8, "serving": 8, "twins": 8.2,
    "clearance": 4, "itinerary": 8.5, "resuming": 8.5,
    "campaign": 9, "planning": 9, "mixing": 9, "rehearsal": 8,
    "referee": 5.5, "workers": 1, "whole": 1, "envs": 10.7, "fleet": 10.6,
    "pages": 2, "diagnosis": 10, "study": 10, "effects_page": 10.1, "blind": 10.5,
    "report": 11, "viewer": 11.5,
    "cli": 12, "__init__": 12, "__main__": 13,
}  # fmt: skip
PLUGINS = ("robots", "sensors", "drivers", "transducers", "twins", "effects")
ONLY_IN = {
    "mujoco": (
        "robots", "mjcf", "simulation", "plant", "springs", "assembly", "mechanics",
        "sensor_only", "exporting", "effects", "lookalikes", "referee", "serving", "clearance",
        "viewer", "envs",
    ),
    "rtde_control": ("drivers",), "rtde_receive": ("drivers",), "rtde_io": ("drivers",),
    "dashboard_client": ("drivers",),
    "can": ("drivers", "transducers", "twins", "serving"), "canopen": ("drivers", "twins"),
    "rerun": ("viewer",), "rich": ("cli",), "tyro": ("cli",),
}  # fmt: skip
FILES = sorted(SOURCE.rglob("*.py"))


def unit(path: Path) -> str:
    return path.relative_to(SOURCE).parts[0].removesuffix(".py")


def imports(path: Path) -> list[tuple[str, str]]:
    """(top-level package, unit of wrenchbed or '') of every import, also inside functions."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = []
        if isinstance(node, ast.Import):
            names = [a.name for a in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module]
            if node.module == "wrenchbed":
                names = [f"wrenchbed.{a.name}" for a in node.names]
        for name in names:
            parts = name.split(".")
            found.append((parts[0], parts[1] if parts[0] == "wrenchbed" and parts[1:] else ""))
    return found


def each_file(test):
    return pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(SOURCE)))(test)


def test_there_are_files_to_check():
    assert len(FILES) > 30


@each_file
def test_every_file_has_a_layer(path):
    assert unit(path) in LAYERS


@each_file
def test_imports_go_down(path):
    own = unit(path)
    for package, other in imports(path):
        if package == "wrenchbed" and other and other != own:
            assert LAYERS[other] < LAYERS[own], f"{own} imports {other}"


@each_file
def test_a_plugin_imports_no_sibling(path):
    parts = path.relative_to(SOURCE).parts
    if parts[0] not in PLUGINS or len(parts) < 2:
        return
    mine = parts[1].removesuffix(".py")
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(
            f"wrenchbed.{parts[0]}."
        ):
            other = node.module.split(".")[2]
            assert other in ("base", mine), f"{path.name} imports {node.module}"


@each_file
def test_heavy_libraries_stay_in_their_corner(path):
    for package, _ in imports(path):
        if package in ONLY_IN:
            assert unit(path) in ONLY_IN[package], f"{path.name} imports {package}"


@each_file
def test_only_the_command_line_prints(path):
    calls = [n for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.Call)]
    prints = [n for n in calls if isinstance(n.func, ast.Name) and n.func.id == "print"]
    assert not prints or unit(path) == "cli"


@each_file
def test_files_stay_short_and_say_what_they_are_for(path):
    text = path.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 300
    assert ast.get_docstring(ast.parse(text))


@each_file
def test_everything_public_is_explained(path):
    def check(body, where):
        for node in body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                assert ast.get_docstring(node), f"{where}.{node.name}"

    check(ast.parse(path.read_text(encoding="utf-8")).body, path.name)


def test_the_core_loads_no_optional_library():
    import subprocess

    code = (
        "import wrenchbed.cli, sys; "
        "optional = ('rerun', 'can', 'canopen', 'rtde_control', 'pinocchio'); "
        "print([m for m in optional if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
