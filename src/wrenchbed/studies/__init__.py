"""Published studies run again: their tables and figures on MuJoCo data, beside what they print.
May import: campaigns (recording), hardware, planning, calibration, pages and the rooms below them.
Read first: `medrue`, then `ur5`.
Used by: cli.
"""

import math
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

from wrenchbed import registry
from wrenchbed.errors import NotFoundError, ParameterError
from wrenchbed.jobs.workers import Progress, silent
from wrenchbed.pages.document import provenance

PAPERS = ("medrue", "ur5")


@dataclass(frozen=True)
class StudyResult:
    """Results of a study: its folder, key results, and lines for people."""

    folder: Path
    summary: dict[str, Any]
    lines: tuple[str, ...]


def steps(paper: str, quick: bool, robots: int | None) -> int:
    """Number of steps of a study."""
    return int(_module(paper).steps(quick, robots))


def run(
    paper: str,
    folder: Path,
    *,
    quick: bool = False,
    robots: int | None = None,
    seed: int = 0,
    report: Progress = silent,
    command: str = "",
) -> StudyResult:
    """Run a study; a stopped run continues where it stopped.

    Raises:
        NotFoundError: no such paper.
        MissingExtraError: the extra ``report`` is not installed.
    """
    module = _module(paper)
    if robots is not None and robots < 2:
        raise ParameterError(f"{robots} robots (or repetitions) are too few: at least 2")
    for library in ("matplotlib", "jinja2"):
        registry.require(library, "report")
    folder.mkdir(parents=True, exist_ok=True)
    page = module.run(folder, quick, robots, seed, report)
    results = sorted(folder.glob("*.parquet"))
    page = replace(page, data=provenance(results, command, seed))
    summary = _finite(page.summary)
    page.write(folder, paper, summary)
    lines = (page.lead, f"tables and figures → {folder / paper}.html, {folder / paper}.md")
    return StudyResult(folder, summary, lines)


def _finite(value: Any) -> Any:
    """Value for JSON, with null for numbers that are not finite."""
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_finite(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _module(paper: str) -> Any:
    if paper not in PAPERS:
        raise NotFoundError(f"there is no study {paper!r}. Known: {', '.join(PAPERS)}")
    return import_module(f"wrenchbed.studies.{paper}")
