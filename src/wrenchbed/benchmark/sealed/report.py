"""The score as a page: Markdown and one HTML file.

Figures of a score: how far its probabilities hold, and how small an effect it finds.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wrenchbed.benchmark.frame import SUBSYSTEMS, subsystem
from wrenchbed.benchmark.scoring.case_rows import OURS, CaseRow
from wrenchbed.benchmark.scoring.metrics import (
    Metric,
    ScoredMetric,
    effect_cells,
    exact_interval,
    figure,
    figure_cells,
    right,
    shares,
    sized,
)
from wrenchbed.benchmark.sealed.score import ORACLE, Score
from wrenchbed.pages.chart import Axis, Chart, Panel, Role, Series
from wrenchbed.pages.document import Card, Document, Figure, Section, Table
from wrenchbed.pages.provenance import provenance

_BINS = np.array([0.0, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0 + 1e-9])
"""Edges of stated probabilities that are shown together."""
_SHARE = Axis("share of cases", "%", low=0.0, high=104.0, ticks=(0.0, 25.0, 50.0, 75.0, 100.0))
_ORDER = ("none", *SUBSYSTEMS, "unknown", "error")
_ORACLE = (
    "The oracle is told the exact form and size of all that may be there; it names what the same "
    "data holds, with every effect that could imitate it there."
)
_SEMI_REAL = (
    "The recording alone has a calibrated gap of {gap:.2f}. What is wrong in it nobody knows: only "
    "the added effects are held against the claims."
)


def reliability(rows: Sequence[CaseRow]) -> Chart:
    """Stated probability of first answers beside the share that was right, with 95 % intervals."""
    stated = np.array([r.answers[OURS].sure for r in rows])
    held = np.array([right(r, r.answers[OURS]) for r in rows])
    which = np.digitize(stated, _BINS) - 1
    used = np.unique(which)
    groups = [held[which == k] for k in used]
    means = np.array([100 * stated[which == k].mean() for k in used])
    shares = np.array([100 * group.mean() for group in groups])
    ends = _ends([(int(group.sum()), len(group)) for group in groups])
    x = np.arange(len(used))
    series = (
        Series("stated", "points", x, means, role="before", mark="ring"),
        Series("right, with 95 % interval", "points", x, shares, ends=ends),
    )
    names = tuple(
        f"{100 * _BINS[k]:.0f}–{100 * _BINS[k + 1]:.0f}\nn = {len(group)}"
        for k, group in zip(used, groups, strict=True)
    )
    axis = Axis("stated probability of the first answer [%]", names=names)
    panel = Panel(axis, _SHARE, series, height=1.7)
    caption = "A ring within the upright line: what was stated agrees with how often it was right."
    return Chart("", "", (panel,), caption=caption)


def detection(rows: Sequence[CaseRow], score: Score) -> Chart:
    """Shares isolated against the gap, of the entrant, the oracle and BIC; and those noticed."""
    groups = [(span, members) for span, members in sized(rows) if members]
    labels = tuple(f"{span}\nn = {len(members)}" for span, members in groups)
    named: tuple[tuple[str, str, Role], ...] = (
        (ORACLE, "oracle", "box"), ("bic", "BIC", "before"), (OURS, score.main, "measured"),
    )  # fmt: skip
    x, panels = np.arange(len(groups)), []
    axis = Axis("gap that the effect adds", names=labels)
    for k, what in ((1, "isolated"), (0, "noticed")):
        series = []
        for method, name, role in named:
            if method != OURS and method not in score.beside:
                continue
            hits = [(shares(members, method)[k], len(members)) for _, members in groups]
            y = np.array([100.0 * hit / count for hit, count in hits])
            series.append(Series(name, "line", x, y, role=role, dashed=method != OURS))
            if method == OURS:
                series.append(Series(name, "points", x, y, role=role, ends=_ends(hits)))
        panels.append(Panel(axis, _SHARE, tuple(series), title=what, height=1.4))
    caption = "Isolated: a claimed class holds the effect. Noticed: any answer but none. "
    caption += f"Upright lines: 95 % intervals of {score.main}."
    return Chart("", "", tuple(panels), columns=2, caption=caption)


def _ends(counts: Sequence[tuple[int, int]]) -> tuple[np.ndarray, np.ndarray]:
    """Ends of exact intervals of shares (N,) [%]."""
    low, high = 100.0 * np.array([exact_interval(k, n) for k, n in counts]).reshape(-1, 2).T
    return low, high


def page(score: Score, command: str = "") -> Document:
    """Every figure of a score, with the command that made it.

    The page does not state the seed of the cases: all answers follow from it.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    rows, some = score.rows, next(iter(score.answers.values()))
    kinds = Counter(r.kind for r in rows)
    counts = ", ".join(f"{kinds[k]} {k}" for k in ("single", "none", "outside", "pair"))
    missing = f" {score.unclaimed} cases have no claim: they count as wrong."
    lead = (
        f"{len(rows)} sealed cases: {counts}.{missing if score.unclaimed else ''} Every recording "
        "and every answer is the one that was committed to."
    )
    what = "cases of a real recording" if score.is_semi_real else "robots"
    title = f"Sealed benchmark: {score.main} on {len(rows)} {what} ({some.robot}, {some.mode})"
    about = _SEMI_REAL.format(gap=some.real_gap) if score.is_semi_real else _ORACLE
    head, lines = figure_cells(rows, [OURS, *score.beside], score.metrics, score.main)
    judged = [(m, figure(m, rows, OURS)) for m in score.metrics.values()]
    marks = ["" if scored is None else marked(m, scored) for m, scored in judged]
    for cells, mark in zip(lines, marks, strict=True):
        cells[1] = f"{cells[1]} {mark}".rstrip()
    sections = (
        Section(
            "Figures",
            "Intervals are 95 %: exact of shares of cases (Clopper & Pearson), else by bootstrap "
            "over cases. ✓: target met, ✗: missed; in brackets where the interval allows "
            "both: too few cases to tell. " + about,
            (Table.of("Every figure", head, lines),),
        ),
        Section(
            "What it says, and how often that is right",
            "Stated probability of the first answer against how often it was right; how often "
            "single effects are noticed and isolated, against the gap that they add.",
            (
                Figure("reliability", "Reliability", reliability(rows)),
                Figure("detection", "Detection against size", detection(rows, score)),
            ),
        ),
        Section(
            "Where", "First answers by the subsystem of what is truly wrong.", (_confusion(rows),)
        ),
        Section(
            "Effects one by one",
            "Single effects, and faults outside the library, to which the right answer is "
            "`unknown`.",
            (Table.of("Effects and outside faults", *effect_cells(rows)),),
        ),
        Section("Wrong answers", "Every case whose first answer is wrong.", (_wrong(rows),)),
    )
    data = [("SHA-256 of the commitments", score.root), *provenance([], command)]
    missed = [m.title for (m, _), mark in zip(judged, marks, strict=True) if mark == "✗"]
    return Document(title, lead, sections, "", summary(score), data, (_targets(marks, missed),))


def _targets(marks: Sequence[str], missed: Sequence[str]) -> Card:
    """Card of the targets met."""
    total, open_ = sum(map(bool, marks)), sum("(" in mark for mark in marks)
    remark = f"For {open_} of them the cases are too few: the interval allows met and missed."
    if not open_:
        remark = "Every one of them beyond its 95 % interval."
    if missed:
        remark += f" Missed for sure: {'; '.join(missed)}."
    return Card("Targets", f"{sum('✓' in mark for mark in marks)} of {total} met", remark)


def marked(metric: Metric, scored: ScoredMetric) -> str:
    """✓ or ✗ at its target, in brackets where the interval allows the other; empty without one."""
    goal = _goal(metric)
    if goal is None:
        return ""
    low, high = goal
    value, least, most = (_shown(metric, x) for x in (scored.value, scored.low, scored.high))
    met = low <= value <= high
    exact = re.match(r"\d+ %$", metric.target)  # of the cases themselves
    sure = low <= least and most <= high if met else most < low or least > high
    return ("✓" if met else "✗") if exact or sure else ("(✓)" if met else "(✗)")


def _goal(metric: Metric) -> tuple[float, float] | None:
    """Smallest and largest figure that meets a metric's target, in the unit of the target's text;
    None if the metric has no target."""
    parts = re.fullmatch(r"([≥≤<>]?) ?([\d.]+)(?:–([\d.]+))?( %)?", metric.target)
    if parts is None:
        return None
    x = float(parts[2])
    ends = {
        "≥": (x, np.inf), ">": (np.nextafter(x, np.inf), np.inf), "≤": (-np.inf, x),
        "<": (-np.inf, np.nextafter(x, -np.inf)), "": (x, float(parts[3] or x)),
    }  # fmt: skip
    return ends[parts[1]]


def _shown(metric: Metric, value: float) -> float:
    return 100.0 * value if metric.percent else value


def summary(score: Score) -> dict[str, object]:
    """Every figure by entrant and name: value, 95 % interval and count."""
    result: dict[str, object] = {
        "cases": len(score.rows), "unclaimed": score.unclaimed, "commitments": score.root,
        "main": score.main,
    }  # fmt: skip
    for method in (OURS, *score.beside):
        entries = {}
        for key, metric in score.metrics.items():
            scored = None if metric.ours and method != OURS else figure(metric, score.rows, method)
            if scored is not None:
                ends = [scored.low, scored.high]
                entries[key] = {"value": scored.value, "ci95": ends, "n": scored.count}
        result[score.main if method == OURS else method] = entries
    return result


def _truth(row: CaseRow, answer: str) -> str:
    """True subsystem; if there are two, the one that was answered."""
    if row.kind in ("none", "outside"):
        return "none" if row.kind == "none" else "unknown"
    subsystems = [subsystem(t) for t in row.truth]
    return answer if answer in subsystems else subsystems[0]


def _confusion(rows: Sequence[CaseRow]) -> Table:
    claims = [r.answers[OURS] for r in rows]
    answers = [subsystem(c.causes[0][0]) if c.causes else c.verdict for c in claims]
    counts = Counter((_truth(r, a), a) for r, a in zip(rows, answers, strict=True))
    columns = [s for s in _ORDER if s in answers]
    lines = [
        [f"{t} ({sum(counts[t, s] for s in columns)})", *(str(counts[t, s] or "") for s in columns)]
        for t in _ORDER
        if any(key[0] == t for key in counts)
    ]
    return Table.of("True subsystem (down) and first answer (across)", ["", *columns], lines)


def _wrong(rows: Sequence[CaseRow]) -> Table:
    lines = []
    for row in rows:
        claim = row.answers[OURS]
        if right(row, claim):
            continue
        truth = ", ".join(row.truth) or row.outside or "none"
        answer = "; ".join(" or ".join(c) for c in claim.causes) or claim.verdict
        size = max(row.size.values(), default=float("nan"))
        error = row.error.strip().split("\n")[-1][:80]
        lines.append([row.id, truth, size, answer, claim.sure, error])
    head = ["case", "truth", "gap", "said", "p", "error"]
    table = Table.of("Wrong first answers", head, lines)
    return replace(table, empty="Every first answer is right.")
