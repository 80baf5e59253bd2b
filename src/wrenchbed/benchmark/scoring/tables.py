"""Figures of a benchmark as Markdown, and where they stand in a document."""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from wrenchbed.benchmark.scoring.metrics import DRAWS, METRICS, Metric, ScoredMetric, figure, holds
from wrenchbed.benchmark.scoring.rows import OURS, CaseRow
from wrenchbed.diagnosis.evidence.search import NONE, UNKNOWN
from wrenchbed.errors import DiagnosisError

EDGES = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, np.inf)
"""Of the sizes that detection is shown against, in gap."""


Cells = tuple[list[str], list[list[str]]]
"""Heads and rows of a table."""


def markdown(cells: Cells) -> str:
    """A table."""
    head, rows = cells
    return "\n".join([_line(*head), "|" + "---|" * len(head), *(_line(*r) for r in rows)])


def figures(rows: Sequence[CaseRow], methods: Sequence[str], draws: int = DRAWS) -> str:
    """Target, figure and each other method's, one line a metric, as Markdown."""
    head, told = figure_cells(rows, methods, METRICS, "wrenchbed", draws)
    for cells in told:
        value, bracket, rest = cells[2].partition(" (")
        cells[2] = f"**{value}**{bracket}{rest}" if bracket else value
    return markdown((head, told))


def figure_cells(
    rows: Sequence[CaseRow],
    methods: Sequence[str],
    metrics: Mapping[str, Metric],
    main: str,
    draws: int = DRAWS,
) -> Cells:
    """Target, figure of the main method and each other's, one line a metric."""
    others = [m for m in methods if m != OURS]
    told = []
    for metric in metrics.values():
        own = figure(metric, rows, OURS, draws)
        theirs = [
            "–" if metric.ours else _told(metric, figure(metric, rows, m, draws)) for m in others
        ]
        count = "" if own is None else str(own.count)
        told.append([metric.title, metric.target, _told(metric, own, wide=True), count, *theirs])
    return ["", "target", f"{main} (95 %)", "n", *others], told


def by_effect(rows: Sequence[CaseRow]) -> str:
    """What became of the single effects, one line each, as Markdown."""
    return markdown(effect_cells(rows))


def effect_cells(rows: Sequence[CaseRow]) -> Cells:
    """What became of the single effects, one line each."""
    head = ["effect", "n", "median gap", "isolated", "none", "unknown", "otherwise named"]
    singles = [r for r in rows if r.kind == "single"]
    told = []
    for name in sorted({r.truth[0] for r in singles}):
        own = [r for r in singles if r.truth[0] == name]
        claims = [r.answers[OURS] for r in own]
        held = sum(holds(c, (name,)) for c in claims)
        counts = [sum(c.verdict == v for c in claims) for v in (NONE, UNKNOWN)]
        wrong: dict[str, int] = {}
        for c in claims:
            if c.causes and not holds(c, (name,)):
                wrong[c.causes[0][0]] = wrong.get(c.causes[0][0], 0) + 1
        said = ", ".join(f"{k} {v}" for k, v in sorted(wrong.items(), key=lambda i: -i[1]))
        size = float(np.median([r.size[name] for r in own]))
        title = f"{name} (between rows)" if own[0].between else name
        gap = f"{size:.0f}" if size >= 99.5 else f"{size:.2g}" if np.isfinite(size) else "–"
        told.append([title, str(len(own)), gap, str(held), *map(str, counts), said])
    return head, told


def by_size(rows: Sequence[CaseRow], methods: Sequence[str] = (OURS,)) -> str:
    """How often single effects are noticed and isolated, against the gap that they add."""
    heads = [f"{m}: {what}" for m in methods for what in ("noticed", "isolated")]
    told = []
    for (low, high), own in sized(rows):
        cells = []
        for m in methods:
            for share in shares(own, m):
                cells.append("–" if share is None else f"{100 * share:.0f} %")
        span = f"{low:g}–{high:g}" if np.isfinite(high) else f"> {low:g}"
        told.append([span, str(len(own)), *cells])
    return markdown((["gap", "n", *heads], told))


def sized(rows: Sequence[CaseRow]) -> list[tuple[tuple[float, float], list[CaseRow]]]:
    """Single effects that show in means, by the gap that they add."""
    singles = [r for r in rows if r.kind == "single" and not r.between]
    return [
        ((low, high), [r for r in singles if low <= r.size[r.truth[0]] < high])
        for low, high in pairwise(EDGES)
    ]


def shares(rows: Sequence[CaseRow], method: str) -> tuple[float | None, float | None]:
    """Shares of cases in which a method says anything but none, and in which a class is right."""
    claims = [(r, r.answers[method]) for r in rows]
    if not claims:
        return None, None
    seen = np.mean([c.verdict != NONE for _, c in claims])
    return float(seen), float(np.mean([holds(c, r.truth) for r, c in claims]))


def placed(document: str, name: str, text: str) -> str:
    """A document with the text between its marks ``<!-- begin NAME -->`` and ``<!-- end -->``.

    Raises:
        DiagnosisError: the marks are missing.
    """
    begin, end = f"<!-- begin {name} -->", "<!-- end -->"
    head, found, rest = document.partition(begin)
    _, closed, tail = rest.partition(end)
    if not found or not closed:
        raise DiagnosisError(f"the document has no place for {name}: it needs {begin} … {end}")
    return f"{head}{begin}\n{text.strip()}\n{end}{tail}"


def _told(metric: Metric, f: ScoredMetric | None, *, wide: bool = False) -> str:
    if f is None:
        return "–"
    if metric.percent:
        value, low, high = (f"{100 * x:.0f}" for x in (f.value, f.low, f.high))
        return f"{value} % ({low}–{high})" if wide else f"{value} %"
    value, low, high = (f"{x:.2f}" for x in (f.value, f.low, f.high))
    return f"{value} ({low}–{high})" if wide else value


def _line(*cells: str) -> str:
    return "| " + " | ".join(cells) + " |"
