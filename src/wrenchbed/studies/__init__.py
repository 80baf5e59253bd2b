"""Published studies run again: their tables and figures on MuJoCo data, beside what they print.
Free: the inside of each file (layout of pages); tests/studies/test_studies.py speaks.
Others rely on: docs/studies and docs/explanation/studies.md print these numbers: run
`scripts/studies` after a change of a method, a scenario or a seed.
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
    """Number of progress steps of a study: ``paper`` medrue or ur5; ``robots`` (None: default) as
    of `run`."""
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
    """Run the study of a ``paper``, medrue or ur5, write its page to ``folder``; a stopped run goes
    on. ``quick``: a small version; ``robots``: number of random MedRUE robots, or of repetitions on
    the UR5; None: 200 and 20, quick 8 and 3. A `MissingExtraError` without the extra ``report``."""
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
    """Return a JSON value (list, dict, number …) with null for each number that is not finite."""
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_finite(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
