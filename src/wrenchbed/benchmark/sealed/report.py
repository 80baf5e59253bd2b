"""The score as a page, in Markdown and HTML: how good an entrant is, how far its probabilities
hold, and how small an effect it finds.
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from wrenchbed.benchmark.scoring import metrics
from wrenchbed.benchmark.scoring.metrics import METRICS, Figures
from wrenchbed.benchmark.scoring.truth_and_claims import OURS, CaseRow
from wrenchbed.benchmark.sealed.score import ORACLE, Score
from wrenchbed.pages.document import Card, Document, Section, Table, provenance

_BINS = np.array([0.0, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0 + 1e-9])
"""Edges of stated probabilities that are shown together."""
_ANSWERS = {
    "sure": ("Claims with p > 0.9", "right"), "isolation": ("Effects that show", "isolated"),
    "unknown": ("Outside the library", "called unknown"),
    "false_alarm": ("No gap", "answered otherwise"),
}  # fmt: skip
"""Label and verb of the metrics of the first screen, by key in `METRICS`."""
_ORACLE = (
    "The oracle is told the exact form and size of all that may be there; it names what the same "
    "data holds, with every effect that could imitate it there."
)


def _reliability(rows: Sequence[CaseRow]) -> Table:
    """Table of stated probabilities of leading answers beside the share that was right."""
    stated = np.array([r.claims[OURS].sure for r in rows])
    held = np.array([metrics.right(r.truth, r.claims[OURS]) for r in rows])
    which = np.digitize(stated, _BINS) - 1
    lines = []
    for k in np.unique(which):
        hits, count = int(held[which == k].sum()), int((which == k).sum())
        low, high = metrics.exact_interval(hits, count)
        span = f"{100 * _BINS[k]:.0f}–{100 * _BINS[k + 1]:.0f} %"
        share = f"{100 * hits / count:.0f} % ({100 * low:.0f}–{100 * high:.0f})"
        lines.append([span, count, f"{100 * stated[which == k].mean():.0f} %", share])
    return Table.of("Reliability", ["stated", "n", "mean", "right, with 95 % interval"], lines)


def page(score: Score, command: str = "") -> Document:
    """Page of all figures of a score, with the command that made it.

    The page does not state the seed of the cases: all answers follow from it.
    """
    rows, some = score.rows, score.rows[0].truth
    kinds = Counter(r.truth.kind for r in rows)
    counts = ", ".join(f"{kinds[k]} {k}" for k in ("single", "none", "outside", "pair"))
    missing = f" {score.unclaimed} cases have no claim: they count as wrong."
    about = (
        f"{len(rows)} sealed cases: {counts}. Every recording and every answer is the one that was "
        "committed to. "
    )
    title = f"Sealed benchmark: {score.main} on {len(rows)} robots ({some.robot}, {some.mode})"
    oracle = _ORACLE if ORACLE in score.beside else ""
    figures = metrics.figures(rows, (OURS, *score.beside))
    marks = {k: marked(m, x) for k, m in METRICS.items() if (x := figures[OURS][k]) is not None}
    head = ["", "target", f"{score.main} (95 %)", "n", *score.beside]
    lines = []
    for key, metric in METRICS.items():
        scored = figures[OURS][key]
        beside = [metric.text(figures[m][key], wide=False) for m in score.beside]
        target = f"{metric.target} {marks.get(key, '')}".rstrip()
        count = "" if scored is None else scored.counted
        lines.append([metric.title, target, metric.text(scored), count, *beside])
    sections = (
        Section(
            "Figures",
            f"{about}Intervals are 95 %: exact of shares of cases (Clopper & Pearson), else by "
            "bootstrap over cases. ✓: target met, ✗: missed; in brackets where the interval allows "
            f"both: too few cases to tell. {oracle}",
            (Table.of("Every figure", head, lines),),
        ),
        Section(
            "What it says, and how often that is right",
            "Stated probability of the first answer against how often it was right; how often "
            "single effects are noticed and isolated, against the gap that they add.",
            (_reliability(rows), Table.of("Detection against size", *metrics.size_cells(rows))),
        ),
        Section(
            "Effects one by one",
            "Single effects, and faults outside the library, to which the right answer is "
            "`unknown`.",
            (Table.of("Effects and outside faults", *metrics.effect_cells(rows)),),
        ),
        Section("Wrong answers", "Every case whose first answer is wrong.", (_wrong(rows),)),
    )
    data = [("SHA-256 of the commitments", score.root), *provenance([], command)]
    cards = [
        Card(label, f"{x.counted} {verb}", f"{m.text(x)}; target {m.target} {marks[key]}")
        for key, (label, verb) in _ANSWERS.items()
        if (m := METRICS[key]) and (x := figures[OURS][key]) is not None
    ]
    lead = " ".join(f"{card.label}: {card.figure}." for card in cards)
    lead += missing if score.unclaimed else ""
    targets, badge = _targets(marks)
    of_json, every = summary(score, figures), (*cards, targets)
    return Document(title, lead, sections, "", of_json, data, every, badge)


def _targets(marks: Mapping[str, str]) -> tuple[Card, tuple[str, str]]:
    """Card with the number of targets that are met beyond their intervals, from the mark of each
    metric, and the badge of the page."""
    missed = [METRICS[key].title for key, mark in marks.items() if mark == "✗"]
    met, open_ = list(marks.values()).count("✓"), sum("(" in mark for mark in marks.values())
    remark = f"{open_} are open: too few cases, so that the interval allows met and missed."
    badge = ("partial", "◔ targets open") if open_ else ("none", "✓ targets met")
    if missed:
        remark += f" Missed: {'; '.join(missed)}."
        badge = "unknown", "✗ targets missed"
    return Card("Targets", f"{met} of {met + open_ + len(missed)} met", remark), badge


def marked(metric: metrics.Metric, scored: metrics.ScoredMetric) -> str:
    """✓ if a metric meets its target, else ✗, in brackets if its interval allows both; or ""."""
    parts = re.fullmatch(r"([≥≤<]?) ?([\d.]+)(?:–([\d.]+))?( %)?", metric.target)
    if parts is None:
        return ""
    low, high = float(parts[2]), float(parts[3] or parts[2])
    low, high = {"≥": (low, np.inf), "": (low, high)}.get(parts[1], (-np.inf, high))
    scale = 100.0 if metric.percent else 1.0
    value, least, most = (scale * x for x in (scored.value, scored.low, scored.high))
    met = low <= value <= high
    exact = re.match(r"\d+ %$", metric.target)  # of the cases themselves
    sure = low <= least and most <= high if met else most < low or least > high
    return ("✓" if met else "✗") if exact or sure else ("(✓)" if met else "(✗)")


def summary(score: Score, figures: Figures | None = None) -> dict[str, object]:
    """Contents of the score as JSON: by entrant and figure its value, 95 % interval and count."""
    known = figures or metrics.figures(score.rows, (OURS, *score.beside))
    result: dict[str, object] = {
        "cases": len(score.rows), "unclaimed": score.unclaimed, "commitments": score.root,
        "main": score.main,
    }  # fmt: skip
    for method, scored in known.items():
        result[score.main if method == OURS else method] = {
            key: {"value": x.value, "ci95": [x.low, x.high], "n": x.count}
            for key, x in scored.items()
            if x is not None
        }
    return result


def _wrong(rows: Sequence[CaseRow]) -> Table:
    lines = []
    for truth, claims in rows:
        claim = claims[OURS]
        if metrics.right(truth, claim):
            continue
        names = ", ".join(c.effect for c in truth.causes) or "none"
        answer = "; ".join(" or ".join(c) for c in claim.causes) or claim.verdict
        size = max((c.gap for c in truth.causes), default=float("nan"))
        error = claim.error.strip().split("\n")[-1][:80]
        lines.append([truth.case, names, size, answer, claim.sure, error])
    head = ["case", "truth", "gap", "said", "p", "error"]
    return Table.of("Wrong first answers", head, lines)
