"""The score as a page: Markdown and one HTML file.

Figures of a score: how far its probabilities hold, and how small an effect it finds.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wrenchbed.benchmark.scoring.case_rows import OURS, CaseRow
from wrenchbed.benchmark.scoring.metrics import (
    SURE,
    Metric,
    effect_cells,
    figure,
    figure_cells,
    right,
    shares,
    sized,
)
from wrenchbed.benchmark.sealed.score import ORACLE, Score, first
from wrenchbed.pages.chart import Axis, Chart, Panel, Role, Series
from wrenchbed.pages.document import Document, Figure, Section, Table
from wrenchbed.pages.provenance import provenance

_BINS = np.array([0.0, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0 + 1e-9])


def reliability(rows: Sequence[CaseRow]) -> Chart:
    """Stated probability of first answers against the share that was right, with 90 % intervals."""
    stated = np.array([r.answers[OURS].sure for r in rows])
    held = np.array([right(r, r.answers[OURS]) for r in rows])
    which = np.digitize(stated, _BINS) - 1
    used = np.unique(which)
    groups = [held[which == k] for k in used]
    ends = np.array([_interval(int(own.sum()), len(own)) for own in groups])
    points = Series(
        "right, with 90 % interval", "points",
        np.array([100 * float(stated[which == k].mean()) for k in used]),
        np.array([100 * float(own.mean()) for own in groups]),
        ends=(100 * ends[:, 0], 100 * ends[:, 1]), texts=tuple(f"n = {len(own)}" for own in groups),
    )  # fmt: skip
    axis = Axis("stated", "%", low=0.0, high=112.0, ticks=(0.0, 20.0, 40.0, 60.0, 80.0, 100.0))
    panel = Panel(
        axis, replace(axis, label="right", high=104.0), (points,), diagonal=True, height=1.9
    )  # fmt: skip
    return Chart("", "", (panel,), caption="Dashed: right as often as stated.")


def detection(rows: Sequence[CaseRow], score: Score) -> Chart:
    """Shares noticed and isolated against the gap, of the entrant, the oracle and BIC."""
    groups = [(span, own) for span, own in sized(rows) if own]
    labels = tuple(
        f"{low:g}–{high:g}\nn = {len(own)}" if np.isfinite(high) else f"> {low:g}\nn = {len(own)}"
        for (low, high), own in groups
    )
    named: tuple[tuple[str, str, Role], ...] = (
        (OURS, score.main, "measured"), (ORACLE, "oracle", "box"), ("bic", "BIC", "before")
    )  # fmt: skip
    x, series = np.arange(len(groups)), []
    for method, name, role in named:
        if method != OURS and method not in score.beside:
            continue
        told = np.array([[100 * (v or 0) for v in shares(own, method)[:2]] for _, own in groups])
        told = told.reshape(-1, 2)
        series.append(Series(f"{name}: isolated", "line", x, told[:, 1], role=role))
        if method == OURS:
            series.append(
                Series(f"{name}: noticed", "line", x, told[:, 0], role=role, dashed=True)
            )  # fmt: skip
    axis = Axis("gap that the effect adds", "1", names=labels)
    panel = Panel(axis, Axis("share of cases", "%", low=0.0, high=104.0), tuple(series), height=1.9)
    return Chart("", "", (panel,))


def _interval(k: int, n: int) -> tuple[float, float]:
    """Jeffreys' 90 % interval of a share (Brown, Cai & DasGupta 2001)."""
    from scipy.stats import beta

    low = 0.0 if k == 0 else float(beta.ppf(0.05, k + 0.5, n - k + 0.5))
    high = 1.0 if k == n else float(beta.ppf(0.95, k + 0.5, n - k + 0.5))
    return low, high


_ORDER = (
    "none", "sensor", "mount", "tool", "cable", "joint", "link", "base", "timing", "environment",
    "unknown", "error",
)  # fmt: skip


def page(score: Score, command: str = "") -> Document:
    """Every figure of a score, with the command that made it.

    The seed of the cases is not told: all answers follow from it.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    rows, answers = score.rows, score.answers
    some = next(iter(answers.values()))
    kinds = Counter(r.kind for r in rows)
    counts = ", ".join(f"{kinds[k]} {k}" for k in ("single", "none", "outside", "pair"))
    left = (
        f" {score.unclaimed} cases have no claim: they count as wrong." if score.unclaimed else ""
    )
    head, told = figure_cells(rows, [OURS, *score.beside], score.metrics, score.main)
    told = [_marked(cells, m, rows) for cells, m in zip(told, score.metrics.values(), strict=True)]
    title = f"Sealed benchmark: {score.main} on {len(rows)} robots ({some.robot}, {some.mode})"
    about = (
        "The oracle is told the exact form and "
        "size of all that may be there; it names what the same data holds, with every effect "
        "that could imitate it there."
    )
    if score.semi_real:
        title = title.replace(f"{len(rows)} robots", f"{len(rows)} cases of a real recording")
        about = (
            f"The recording alone has a calibrated gap of {some.real_gap:.2f}. What is wrong in it "
            "nobody knows: only the added effects are held against the claims."
        )
    sections = (
        Section(
            "Figures",
            "Intervals are 95 % by bootstrap over cases; ✓ and ✗ say whether a target is met. "
            + about,
            (Table.of("Every figure", head, told),),
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
            "Single effects.",
            (Table.of("Single effects", *effect_cells(rows)),),
        ),
        Section("Outside the library", "The right answer is `unknown`.", (_outside(rows),)),
        Section("Wrong answers", "Every case whose first answer is wrong.", (_wrong(rows),)),
    )
    lead = (
        f"{len(rows)} sealed cases: {counts}.{left} Every recording and every answer is the one "
        "that was committed to."
    )
    data = [("SHA-256 of the commitments", score.root), *provenance([], command)]
    return Document(title, lead, sections, "", summary(score), data)


def _marked(cells: Sequence[str], metric: Metric, rows: Sequence[CaseRow]) -> list[str]:
    """A line of the figures with ✓ or ✗ at its target, where it has one."""
    own = figure(metric, rows, OURS)
    mark = "" if own is None else {True: " ✓", False: " ✗", None: ""}[met(metric, own.value)]
    return [cells[0], f"{cells[1]}{mark}", *cells[2:]]


def met(metric: Metric, value: float) -> bool | None:
    """Whether a figure is as its target says; None without a target."""
    found = re.fullmatch(r"([≥≤<>]?) ?([\d.]+)(?:–([\d.]+))?( %)?", metric.target)
    if found is None:
        return None
    sign, low = found[1], float(found[2])
    shown = 100.0 * value if metric.percent else value
    if found[3]:
        return low <= shown <= float(found[3])
    return {
        "≥": shown >= low, ">": shown > low, "≤": shown <= low, "<": shown < low, "": shown == low
    }[sign]  # fmt: skip


def summary(score: Score) -> dict[str, object]:
    """Every figure by entrant and name: value, 95 % interval and count."""
    names = [OURS, *score.beside]
    told: dict[str, object] = {
        "cases": len(score.rows), "unclaimed": score.unclaimed, "commitments": score.root,
        "main": score.main,
    }  # fmt: skip
    for method in names:
        own = {}
        for key, metric in score.metrics.items():
            found = None if metric.ours and method != OURS else figure(metric, score.rows, method)
            if found is not None:
                own[key] = {
                    "value": found.value, "ci95": [found.low, found.high], "n": found.count,
                }  # fmt: skip
        told[score.main if method == OURS else method] = own
    return told


def _truth(row: CaseRow, answer: str) -> str:
    """True subsystem; of two, the one that was answered."""
    if row.kind in ("none", "outside"):
        return "none" if row.kind == "none" else "unknown"
    own = [t.partition(".")[0] for t in row.truth]
    return answer if answer in own else own[0]


def _confusion(rows: Sequence[CaseRow]) -> Table:
    answers = [first(r.answers[OURS]) for r in rows]
    counts = Counter((_truth(r, a), a) for r, a in zip(rows, answers, strict=True))
    said = [s for s in _ORDER if any(k[1] == s for k in counts)]
    told = [
        [f"{t} ({sum(v for k, v in counts.items() if k[0] == t)})"]
        + [str(counts[(t, s)]) if counts[(t, s)] else "" for s in said]
        for t in _ORDER
        if any(k[0] == t for k in counts)
    ]
    return Table.of("True subsystem (down) and first answer (across)", ["", *said], told)


def _outside(rows: Sequence[CaseRow]) -> Table:
    own = [r for r in rows if r.kind == "outside"]
    told = []
    for family in sorted({str(r.outside) for r in own}):
        claims = [r.answers[OURS] for r in own if r.outside == family]
        named = Counter(c.causes[0][0] for c in claims if c.causes)
        sure = sum(bool(c.causes) and c.sure > SURE for c in claims)
        told.append(
            [
                family, len(claims), sum(c.verdict == "unknown" for c in claims),
                sum(c.verdict == "none" for c in claims), sure,
                ", ".join(f"{k} {v}" for k, v in named.most_common()),
            ]
        )  # fmt: skip
    head = ["family", "n", "unknown", "none", "named, p > 0.9", "named"]
    table = Table.of("Faults outside the library", head, told)
    return replace(table, empty="No case has a fault outside the library.")


def _wrong(rows: Sequence[CaseRow]) -> Table:
    told = []
    for row in rows:
        claim = row.answers[OURS]
        if right(row, claim):
            continue
        truth = ", ".join(row.truth) or row.outside or "none"
        said = "; ".join(" or ".join(c) for c in claim.causes) or claim.verdict
        size = max(row.size.values(), default=float("nan"))
        told.append([row.id, truth, size, said, claim.sure, row.error.strip().split("\n")[-1][:80]])
    head = ["case", "truth", "gap", "said", "p", "error"]
    table = Table.of("Wrong first answers", head, told)
    return replace(table, empty="Every first answer is right.")
