"""Published studies run again: their tables and figures on MuJoCo data, beside what they print.
Free: the inside of each file (layout of pages); tests/studies/test_studies.py speaks.
Others rely on: docs/studies and docs/explanation/studies.md print these numbers (`scripts/studies`
makes them anew after a change, also of a seed).
Never: a number of a paper in the place of a measured one; they stand side by side.
Read first: `medrue`, then `ur5`."""

import math
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

from wrenchbed import registry
from wrenchbed.errors import ParameterError
from wrenchbed.jobs.workers import Progress, silent
from wrenchbed.pages.document import Document, provenance


def steps(paper: str, quick: bool, robots: int | None) -> int:
    """Number of progress steps of the study of a paper, ``medrue`` or ``ur5``."""
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
) -> Document:
    """Run a study and write its page to ``folder``; a stopped run continues where it stopped.

    Raises:
        MissingExtraError: the extra ``report`` is not installed.
    """
    if robots is not None and robots < 2:
        raise ParameterError(f"{robots} robots (or repetitions) are too few: at least 2")
    for library in ("matplotlib", "jinja2"):
        registry.require(library, "report")
    folder.mkdir(parents=True, exist_ok=True)
    page = _module(paper).run(folder, quick, robots, seed, report)
    made = provenance(sorted(folder.glob("*.parquet")), command, seed)
    page = replace(page, data=made, summary=_finite(page.summary))
    page.write(folder, paper, page.summary)
    return page


def _module(paper: str) -> Any:
    return import_module(f"{__name__}.{paper}")


def _finite(value: Any) -> Any:
    """The value with null for each number that is not finite, as JSON needs."""
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_finite(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
