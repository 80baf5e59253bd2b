"""Figures of a benchmark as Markdown, and where they stand in a document."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from wrenchbed.diagnosis.scoring import DRAWS, METRICS, Figure, Metric, holds, score
from wrenchbed.diagnosis.scoring_rows import OURS, Row
from wrenchbed.diagnosis.search import NONE, UNKNOWN
from wrenchbed.errors import DiagnosisError

EDGES = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, np.inf)
"""Of the sizes that detection is shown against, in gap."""


def figures(rows: Sequence[Row], methods: Sequence[str], draws: int = DRAWS) -> str:
    """Target, figure and each other method's, one line a metric."""
    found = {m: score(rows, m, draws) for m in methods}
    others = [m for m in methods if m != OURS]
    lines = [_line("", "target", "wrenchbed (95 %)", "n", *others)]
    lines.append("|" + "---|" * (4 + len(others)))
    for key, metric in METRICS.items():
        own = found[OURS][key]
        theirs = [_told(metric, found[m].get(key)) for m in others]
        count = "" if own is None else str(own.count)
        lines.append(
            _line(metric.title, metric.target, _told(metric, own, wide=True), count, *theirs)
        )
    return "\n".join(lines)


def by_effect(rows: Sequence[Row]) -> str:
    """What became of the single effects, one line each."""
    lines = [_line("effect", "n", "median gap", "isolated", "none", "unknown", "otherwise named")]
    lines.append("|" + "---|" * 7)
    singles = [r for r in rows if r.kind == "single"]
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
        lines.append(_line(title, str(len(own)), f"{size:.2g}", str(held), *map(str, counts), said))
    return "\n".join(lines)


def by_size(rows: Sequence[Row], methods: Sequence[str] = (OURS,)) -> str:
    """How often single effects are noticed and isolated, against the gap that they add."""
    heads = [f"{m}: {what}" for m in methods for what in ("noticed", "isolated")]
    lines = [_line("gap", "n", *heads), "|" + "---|" * (2 + len(heads))]
    singles = [r for r in rows if r.kind == "single" and not r.between]
    for low, high in pairwise(EDGES):
        own = [r for r in singles if low <= r.size[r.truth[0]] < high]
        cells = []
        for m in methods:
            claims = [(r, r.answers[m]) for r in own]
            seen = [c.verdict != NONE for _, c in claims]
            held = [holds(c, r.truth) for r, c in claims]
            cells += [f"{100 * np.mean(x):.0f} %" if x else "–" for x in (seen, held)]
        span = f"{low:g}–{high:g}" if np.isfinite(high) else f"> {low:g}"
        lines.append(_line(span, str(len(own)), *cells))
    return "\n".join(lines)


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


def _told(metric: Metric, f: Figure | None, *, wide: bool = False) -> str:
    if f is None:
        return "–"
    if metric.percent:
        value, low, high = (f"{100 * x:.0f}" for x in (f.value, f.low, f.high))
        return f"**{value} %** ({low}–{high})" if wide else f"{value} %"
    value, low, high = (f"{x:.2f}" for x in (f.value, f.low, f.high))
    return f"**{value}** ({low}–{high})" if wide else value


def _line(*cells: str) -> str:
    return "| " + " | ".join(cells) + " |"
