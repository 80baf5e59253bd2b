"""Blocks of code on the pages of the documentation, and a place to run them."""

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
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
    """Blocks of a page in their order."""
    text = page.read_text(encoding="utf-8")
    result = []
    for found in _FENCE.finditer(text):
        line = text.count("\n", 0, found.start("language")) + 1
        width = len(found["indent"])
        code = "".join(row[width:] or "\n" for row in found["code"].splitlines(keepends=True))
        result.append(Block(found["language"], code, line, found["reason"]))
    return result


def to_run(page: Path) -> list[Block]:
    """Blocks that are not excluded."""
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
    """Anchors of a page's headings."""
    bare = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    for heading in re.findall(r"^#+ (.+)$", bare, flags=re.MULTILINE):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)
        yield re.sub(r"[\s]+", "-", re.sub(r"[^\w\s-]", "", plain.lower()).strip())
