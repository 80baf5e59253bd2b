"""The lines of README and docs run, and what the docs name exists."""

import importlib
import importlib.util
import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import pytest

import wrenchbed
from wrenchbed import registry
from wrenchbed.simulation.closed_form import SENSOR

ROOT = Path(__file__).parents[2]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
FOLDERS = ("docs", "models", "requirements", "src", "tests")
OURS = sorted([*ROOT.glob("*.md"), *(p for f in FOLDERS for p in (ROOT / f).rglob("*.md"))])
LIMIT_S = 240
_FENCE = re.compile(
    r"(?:^ *<!-- not run: (?P<reason>[^\n]+) -->\n)?"
    r"^(?P<indent> *)```(?P<language>sh|python)[^\n]*\n(?P<code>.*?)^(?P=indent)```$",
    flags=re.DOTALL | re.MULTILINE,
)


@dataclass(frozen=True)
class Block:
    """One block of shell lines or of Python.

    Attributes:
        reason: why it is not run, None if it is.
    """

    language: str
    code: str
    line: int
    reason: str | None


def blocks(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    result = []
    for found in _FENCE.finditer(text):
        line = text.count("\n", 0, found.start("language")) + 1
        width = len(found["indent"])
        code = "".join(row[width:] or "\n" for row in found["code"].splitlines(keepends=True))
        result.append(Block(found["language"], code, line, found["reason"]))
    return result


def to_run(page: Path) -> list[Block]:
    return [b for b in blocks(page) if b.reason is None]


class Place:
    """A folder that looks like the clone, in which blocks run one after the other."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "clone"
        self.folder.mkdir()
        for name in ("models", "tests", "src", "scripts"):
            (self.folder / name).symlink_to(ROOT / name)
        programs = folder / "bin"
        programs.mkdir()
        for name, module in (("wrenchbed", "-m wrenchbed"), ("python", "")):
            path = programs / name
            path.write_text(f'#!/bin/sh\nexec "{sys.executable}" {module} "$@"\n')
            path.chmod(0o755)
        one = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
        self.environment = os.environ | one | {"PATH": f"{programs}:{os.environ['PATH']}"}
        self.log = folder / "log.txt"

    def run(self, block: Block) -> str:
        """Run a block; what it started in the background ends with it. Returns what it printed."""
        shell = ["bash", "-e", "-o", "pipefail", "-c", block.code]
        command = shell if block.language == "sh" else [sys.executable, "-c", block.code]
        with self.log.open("w+", encoding="utf-8") as log:
            process = subprocess.Popen(
                command, cwd=self.folder, env=self.environment, stdin=subprocess.DEVNULL,
                stdout=log, stderr=subprocess.STDOUT, start_new_session=True,
            )  # fmt: skip
            try:
                status = process.wait(LIMIT_S)
            finally:
                with suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()
            log.seek(0)
            printed = log.read()
        assert status == 0, f"line {block.line} exits with {status}:\n{printed}"
        return printed


def anchors(text: str) -> Iterator[str]:
    bare = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    for heading in re.findall(r"^#+ (.+)$", bare, flags=re.MULTILINE):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)
        yield re.sub(r"[\s]+", "-", re.sub(r"[^\w\s-]", "", plain.lower()).strip())


def name(page: Path) -> str:
    return str(page.relative_to(ROOT))


LONG = {"sealed.md", "second-recording.md", "campaigns.md", "plan.md", "viewing.md", "hardware.md"}
"""Guides whose lines take 15 to 60 s each: run with the studies, not by CI."""


QUICKEST = "effects.md"


def runnable():
    """Pages with blocks to run, the quickest first; emulators keep real time, alone."""
    pages = []
    for page in sorted(PAGES, key=lambda p: p.name != QUICKEST):
        code = "".join(b.code for b in to_run(page))
        marks = [pytest.mark.wire] if "wrenchbed twin " in code else []
        marks += [pytest.mark.study] if page.name in LONG else []
        if code:
            pages.append(pytest.param(page, marks=marks, id=name(page)))
    return pages


@pytest.mark.sampled
@pytest.mark.parametrize("page", runnable())
def test_the_lines_of_a_page_run_in_their_order(page, tmp_path):
    place = Place(tmp_path)
    printed = "".join(place.run(block) for block in to_run(page))
    if page.name == "README.md":
        assert "joint.compliance" in printed and "converged" in printed
        assert "d41 and d42 enter only as their sum" in printed


def test_no_block_escapes():
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        fences = re.findall(r"^ *```(?:sh|shell|bash|python|py)\b", text, flags=re.MULTILINE)
        assert len(fences) == len(blocks(page)), name(page)
        reasons = text.count("<!-- not run")
        assert reasons == sum(b.reason is not None for b in blocks(page)), name(page)


@pytest.mark.parametrize("path", OURS, ids=name)
def test_links_lead_somewhere(path):
    text = path.read_text(encoding="utf-8")
    for target, anchor in re.findall(r"\]\(([^)#\s]*)#?([^)\s]*)\)", text):
        if not target.startswith("http"):
            there = path.parent / target if target else path
            assert there.exists(), f"{path.name}: {target}"
            if anchor:
                known = set(anchors(there.read_text(encoding="utf-8")))
                assert anchor in known, f"{path.name}: {target}#{anchor}"


@pytest.mark.parametrize("page", [*PAGES, ROOT / "CONTRIBUTING.md"], ids=name)
def test_files_that_a_page_names_exist(page):
    text = page.read_text(encoding="utf-8")
    for path in re.findall(r"`((?:src|tests|scripts|models|docs)/[\w./-]+)`", text):
        assert (ROOT / path).exists(), path
    for path in re.findall(r"`([a-z_]+/[a-z_/]+\.py)`", text):
        inside = ROOT / "src" / "wrenchbed" / path
        assert (ROOT / path).exists() or inside.exists(), path
    for module in re.findall(r"`(wrenchbed\.[a-z_]+(?:\.[a-z_]+)*)`", text):
        above, _, last = module.rpartition(".")
        assert importlib.util.find_spec(module) or hasattr(importlib.import_module(above), last)


def test_readme_is_short():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 220


@pytest.mark.slow
@pytest.mark.parametrize("script", ["command_line", "messages"])
def test_a_page_is_what_its_script_writes(script):
    """The program's own help, and all messages: whoever changes a sentence runs the script."""
    command = [sys.executable, str(ROOT / "scripts" / script), "--check"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"run scripts/{script}: {done.stderr}"


def test_public_names_exist_and_are_on_the_page():
    page = (ROOT / "docs" / "reference" / "python.md").read_text(encoding="utf-8")
    shown = set(re.findall(r"^::: wrenchbed\.(\w+)$", page, flags=re.MULTILINE))
    assert shown == set(wrenchbed.__all__) - {"__version__"}


@pytest.mark.slow
def test_the_site_builds_strictly_and_loads_nothing_from_elsewhere(tmp_path):
    for module in ("mkdocs", "material", "mkdocstrings"):
        if importlib.util.find_spec(module) is None:
            pytest.skip(f"{module} is not installed: pip install -e '.[docs]'")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path)]
    quiet = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=ROOT, env=quiet, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    loaded = re.compile(r"<(?:script|img|iframe|link)\b[^>]*\b(?:src|href)=\"?(?:https?:)?//[^>]*>")
    for page in tmp_path.rglob("*.html"):
        found = loaded.findall(page.read_text(encoding="utf-8"))
        assert not found, f"{page.name}: {found[0]}"


def test_every_parameter_is_in_the_nomenclature():
    text = (ROOT / "docs" / "reference" / "nomenclature.md").read_text(encoding="utf-8")
    stems = set(re.findall(r"`([A-Za-z0-9.]+)", text)) | set(re.findall(r"[A-Za-z0-9.]+", text))
    known = [p.name for p in SENSOR]
    for robot in registry.names("robots"):
        known += registry.load("robots", robot).parameters.names
    for parameter in set(known):
        group = parameter.rsplit(".", 1)[0]
        numbered = parameter.rstrip("123456789")
        close = {parameter, group, f"{group}.x", f"{group}.xx", f"{group}.fx", f"{numbered}1"}
        series = {f"L{i}1" for i in (1, 2)} if parameter.startswith("L") else set()
        assert (close | series) & stems, parameter


NOTEBOOK = ROOT / "docs" / "tutorials" / "notebook.ipynb"
NUMBER = r"-?\d+\.?\d*(?:e-?\d+)?"


@pytest.mark.slow
def test_the_notebook_prints_what_it_holds(tmp_path):
    pytest.importorskip("matplotlib")
    cells = [
        c for c in json.loads(NOTEBOOK.read_text("utf-8"))["cells"] if c["cell_type"] == "code"
    ]
    held = "".join(
        "".join(output["text"]) for c in cells for output in c["outputs"] if "text" in output
    )
    assert "identified\njoint.compliance" in held
    code = "\n".join("".join(c["source"]) for c in cells)
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path,
        env=os.environ | {"MPLBACKEND": "Agg"}, check=True,
    )  # fmt: skip
    assert re.sub(NUMBER, "#", done.stdout) == re.sub(NUMBER, "#", held)
    printed = [float(x) for x in re.findall(NUMBER, done.stdout)]
    assert printed == pytest.approx([float(x) for x in re.findall(NUMBER, held)], rel=1e-2)
