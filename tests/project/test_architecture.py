"""The layers hold: rooms import downwards, files import in no circle, plug-ins know no sibling;
one place decides in a diagnosis."""

import ast
import gc
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from wrenchbed.diagnosis.decision.decide import RULES
from wrenchbed.registry import plugin_modules

SOURCE = Path(__file__).parents[2] / "src" / "wrenchbed"
LAYERS = (
    ("errors",),
    ("files",),
    ("jobs", "physics", "registry"),
    ("data", "pages", "robots", "sensors"),
    ("simulation",),
    ("calibration", "effects"),
    ("channels",),
    ("drives", "planning", "twin"),
    ("diagnosis", "exports", "hardware", "plant"),
    ("benchmark", "campaigns", "monitoring", "reports"),
    ("environments", "studies", "viewer"),
    ("__init__",),
    ("cli",),
    ("__main__",),
)
"""Rooms from the ground up. A room imports from layers below its own only."""
MOST_ROOMS, MOST_ARROWS = 30, 227
PLUGINS = {
    "robots": "robots",
    "drivers": "hardware/drivers",
    "transducers": "hardware/transducers",
    "effects": "effects",
    "drives": "effects/drives",
    "exports": "exports",
    "channels": "channels",
}
ONLY_IN = {
    "mujoco": ("robots", "simulation", "effects", "twin", "planning/collisions", "benchmark",
               "plant", "viewer", "environments"),
    "rtde_control": ("hardware/drivers/rtde",), "rtde_receive": ("hardware/drivers/rtde",),
    "rtde_io": ("hardware/drivers/rtde",), "dashboard_client": ("hardware/drivers/rtde",),
    "can": ("hardware",), "canopen": ("hardware",),
    "rerun": ("viewer",), "rich": ("cli",), "tyro": ("cli",),
}  # fmt: skip
DIAGNOSIS = {
    "prepare": set(),
    "evidence": {"prepare"},
    "explain": {"prepare", "evidence"},
    "gap": {"prepare", "evidence", "explain", "next"},
    "decision": {"prepare", "evidence", "explain", "gap"},
    "efforts": {*"prepare evidence explain gap decision next json_entries result".split()},
    "between_rows": {"prepare"},
    "next": {"prepare", "evidence", "explain"},
}
"""What each folder of the diagnosis may import of the others."""
MADE_OF = {"word", "causes", "probabilities", "keys"}
"""Fields of a verdict and of its causes that only the decision sets."""
MAKES = re.compile(r"\bVerdict\(|\b(?:word|causes|probabilities|keys)=")
MOST_RULES, MOST_LINES = 12, 400
"""Of the decision."""
FILES = sorted(SOURCE.rglob("*.py"))
EMULATORS = sorted((SOURCE.parent / "robot_emulators").rglob("*.py"))
ALL = {".".join(p.relative_to(SOURCE).with_suffix("").parts): p for p in FILES}


@cache
def tree(path: Path) -> ast.Module:
    """The syntax tree of a file, kept; the collector need not walk those of all files again."""
    gc.freeze()
    return ast.parse(path.read_text(encoding="utf-8"))


def statements(body: list[ast.stmt]) -> Iterator[ast.stmt]:
    """Statements of a body, also those inside functions and branches."""
    for node in body:
        yield node
        for inside in ("body", "orelse", "finalbody", "handlers", "cases"):
            yield from statements(getattr(node, inside, []))


def room(module: str) -> str:
    return module.split(".")[0]


def folder(module: str) -> str:
    """The folder of a module; a module at the top stands for itself."""
    return module.rpartition(".")[0] or module


@cache
def imports(path: Path) -> tuple[tuple[str, str], ...]:
    """(top-level package, module of wrenchbed or '') of every import, also inside functions."""
    found = []
    for node in statements(tree(path).body):
        if isinstance(node, ast.Import):
            found += [(a.name.split(".")[0], known(a.name)) for a in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            package = node.module.split(".")[0]
            found += [(package, known(f"{node.module}.{a.name}")) for a in node.names]
    return tuple(found)


def known(name: str) -> str:
    """The module of wrenchbed in which a dotted name lies; '' outside wrenchbed."""
    parts = name.split(".")[1:] if name.startswith("wrenchbed") else []
    for end in range(len(parts), 0, -1):
        for module in (".".join(parts[:end]), ".".join([*parts[:end], "__init__"])):
            if module in ALL:
                return module
    return "__init__" if name.split(".")[0] == "wrenchbed" else ""


def graph(name) -> dict[str, set[str]]:
    """Who imports whom, by what ``name`` makes of a module."""
    arrows: dict[str, set[str]] = {name(m): set() for m in ALL}
    for module, path in ALL.items():
        for _, other in imports(path):
            if other and name(other) != name(module):
                arrows[name(module)].add(name(other))
    return arrows


def circles(arrows: dict[str, set[str]]) -> list[str]:
    """Nodes that are left when all that import nothing left are taken away again and again."""
    left = dict(arrows)
    while free := [n for n, targets in left.items() if not targets & left.keys()]:
        for node in free:
            del left[node]
    return sorted(left)


def test_every_room_has_one_layer():
    rooms = [r for layer in LAYERS for r in layer]
    assert sorted(rooms) == sorted({room(m) for m in ALL})
    assert len(rooms) <= MOST_ROOMS


@pytest.mark.slow
def test_rooms_import_downwards():
    level = {r: k for k, layer in enumerate(LAYERS) for r in layer}
    arrows = graph(room)
    assert not [(a, b) for a, others in arrows.items() for b in others if level[b] >= level[a]]
    assert sum(map(len, arrows.values())) <= MOST_ARROWS


@pytest.mark.slow
def test_no_files_and_no_folders_import_in_a_circle():
    assert circles(graph(lambda m: m)) == []
    assert circles(graph(folder)) == []


@pytest.mark.parametrize("place", PLUGINS.values())
def test_a_plugin_imports_no_sibling(place):
    kind = next(k for k, v in PLUGINS.items() if v == place)
    prefix = place.replace("/", ".") + "."
    mine = plugin_modules(kind)
    assert mine
    for module, path in ALL.items():
        if (
            not module.startswith(prefix)
            or (own := module[len(prefix) :].split(".")[0]) not in mine
        ):
            continue
        for _, other in imports(path):
            if other.startswith(prefix):
                sibling = other[len(prefix) :].split(".")[0]
                assert sibling == own or sibling not in mine, f"{module} imports {other}"


def test_heavy_libraries_stay_in_their_corner():
    outside = [
        f"{place} imports {package}"
        for path in FILES
        for place in [path.relative_to(SOURCE).with_suffix("").as_posix()]
        for package, _ in imports(path)
        if package in ONLY_IN and not place.startswith(ONLY_IN[package])
    ]
    assert not outside


def inside(place: str) -> list[str]:
    return [m for m in ALL if m.startswith(f"{place}.")]


def reached(place: str) -> set[str]:
    """Modules that those of a place import, even indirectly; the package itself names all verbs."""
    every: set[str] = {"__init__"}
    todo = set(inside(place))
    while todo:
        every |= todo
        todo = {other for m in todo for _, other in imports(ALL[m]) if other} - every
    return every


def test_the_referee_shares_no_effect_code_even_indirectly():
    found = reached("benchmark.referee")
    assert {"robots.base", "data.recording", "data.metadata"} < found
    judged = ("effects", "simulation", "twin", "benchmark.lookalikes", "diagnosis", "hardware")
    assert not [m for m in found if m.startswith(judged)]


@pytest.mark.parametrize(
    ("place", "others"),
    [
        ("benchmark.lookalikes", ["effects", "simulation", "diagnosis", "twin"]),
        ("benchmark.efforts", ["drives", "effects", "diagnosis", "simulation",
                               "physics.rigid_load_regressor"]),
        *((place, ["benchmark.referee"]) for place in
          ("effects", "simulation", "twin", "benchmark.lookalikes", "diagnosis")),
    ],
)  # fmt: skip
def test_no_judge_imports_what_it_judges_and_the_library_not_the_referee(place, others):
    found = {(m, other) for m in inside(place) for _, other in imports(ALL[m])}
    assert found
    for other in others:
        assert other in ALL or inside(other)
        assert not [(m, o) for m, o in found if o.startswith(other)]


def test_referee_and_look_alikes_share_faults_and_mujoco_loads_only():
    both = reached("benchmark.referee") & reached("benchmark.lookalikes")
    shared = {"benchmark.fault", "benchmark.mujoco_loads"}
    assert {m for m in both if m.startswith("benchmark.")} == shared


@pytest.mark.parametrize("folder", DIAGNOSIS)
def test_a_folder_of_the_diagnosis_imports_only_what_is_below_it(folder):
    for module in inside(f"diagnosis.{folder}"):
        for _, other in imports(ALL[module]):
            if other.startswith("diagnosis."):
                assert other.split(".")[1] in {folder, *DIAGNOSIS[folder]}, f"{module}: {other}"


def test_every_folder_of_the_diagnosis_is_listed():
    assert {p.parent.name for p in SOURCE.glob("diagnosis/*/__init__.py")} == set(DIAGNOSIS)


def makers(made: ast.Module) -> list[int]:
    """Lines that make a verdict, or change one or its causes."""
    lines = []
    for node in ast.walk(made):
        if not isinstance(node, ast.Call):
            continue
        name = getattr(node.func, "id", getattr(node.func, "attr", ""))
        changes = {k.arg for k in node.keywords} & MADE_OF if name == "replace" else set()
        if name == "Verdict" or changes:
            lines.append(node.lineno)
    return lines


def test_a_maker_is_seen():
    text = "v = Verdict('none', (), None, {})\nw = replace(v, word='unknown')"
    assert makers(ast.parse(text)) == [1, 2]
    assert makers(ast.parse("w = replace(d, notes=())\nx = word(v)")) == []


def test_only_the_decision_makes_or_changes_a_verdict():
    """The entries of a diagnosis follow from it: `json_entries` fills them in."""
    makes = {m for m, path in ALL.items()
             if MAKES.search(path.read_text(encoding="utf-8")) and makers(tree(path))}  # fmt: skip
    assert makes <= {"diagnosis.decision.decide", "diagnosis.json_entries"}


def test_the_decision_is_a_page_with_few_rules():
    assert len(RULES) + 1 <= MOST_RULES  # with that of rivals
    page = ALL["diagnosis.decision.decide"].read_text(encoding="utf-8")
    assert len(page.splitlines()) <= MOST_LINES
    assert all(rule.__doc__ for rule in RULES.values())


def test_files_and_public_classes_say_what_they_are_for():
    unexplained = [str(path) for path in FILES + EMULATORS if not ast.get_docstring(tree(path))]
    unexplained += [
        f"{path.name}: {node.name}"
        for path in FILES + EMULATORS
        for node in tree(path).body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
        and not ast.get_docstring(node)
    ]  # fmt: skip
    assert not unexplained


def test_constants_stand_before_the_first_definition():
    """But those that are made of a definition of their file."""
    late = [name for path in FILES + EMULATORS for name in late_constants(path)]
    assert not late


def late_constants(path: Path) -> list[str]:
    """Constants of a file after its first function or class, unless they use such a name."""
    names: set[str] = set()
    late = []
    for node in tree(path).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef | ast.AsyncFunctionDef):
            names.add(node.name)
        elif isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None and names:
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            if all(isinstance(t, ast.Name | ast.Tuple) for t in targets):
                used = {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}
                if used & names:
                    names |= used
                else:
                    late.append(f"{path.name}:{node.lineno}")
    return late


def imported(path: Path) -> set[str]:
    """Dotted names of the modules that a file imports from."""
    nodes = list(statements(tree(path).body))
    plain = {a.name for n in nodes if isinstance(n, ast.Import) for a in n.names}
    return plain | {str(n.module) for n in nodes if isinstance(n, ast.ImportFrom)}


@pytest.mark.parametrize("path", EMULATORS, ids=lambda p: str(p.relative_to(SOURCE.parent)))
def test_the_emulators_know_nothing_of_this_package(path):
    assert not [m for m in imported(path) if m.split(".")[0] in ("wrenchbed", "mujoco")]


def test_the_emulators_are_entered_by_their_door_and_from_one_room():
    doors = {(room(m), name) for m, path in ALL.items() for name in imported(path)
             if name.split(".")[0] == "robot_emulators"}  # fmt: skip
    assert doors == {("plant", "robot_emulators")}
