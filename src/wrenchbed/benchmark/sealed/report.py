"""The score as a page: Markdown and one HTML file.

Figures of a score: how far its probabilities hold, and how small an effect it finds.
"""

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from wrenchbed.benchmark.frame import subsystem
from wrenchbed.benchmark.scoring.case_rows import OURS, CaseRow
from wrenchbed.benchmark.scoring.metrics import (
    SURE,
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

_STEPS = 201
"""Places of an interval that are held against a target."""
_BINS = np.array([0.0, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0 + 1e-9])
_SHARE = Axis("share of cases", "%", low=0.0, high=104.0, ticks=(0.0, 25.0, 50.0, 75.0, 100.0))
_ORDER = (
    "none", "sensor", "mount", "tool", "cable", "joint", "link", "base", "timing", "environment",
    "unknown", "error",
)  # fmt: skip


def reliability(rows: Sequence[CaseRow]) -> Chart:
    """Stated probability of first answers beside the share that was right, with 95 % intervals."""
    stated = np.array([r.answers[OURS].sure for r in rows])
    held = np.array([right(r, r.answers[OURS]) for r in rows])
    which = np.digitize(stated, _BINS) - 1
    used = np.unique(which)
    groups = [held[which == k] for k in used]
    x, ends = np.arange(len(used)), _ends([(int(own.sum()), len(own)) for own in groups])
    series = (
        Series(
            "stated", "points", x, np.array([100 * stated[which == k].mean() for k in used]),
            role="before", mark="ring",
        ),
        Series(
            "right, with 95 % interval", "points", x,
            np.array([100 * own.mean() for own in groups]), ends=ends,
        ),
    )  # fmt: skip
    names = tuple(
        f"{100 * _BINS[k]:.0f}–{100 * _BINS[k + 1]:.0f}\nn = {len(own)}"
        for k, own in zip(used, groups, strict=True)
    )
    axis = Axis("stated probability of the first answer [%]", names=names)
    panel = Panel(axis, _SHARE, series, height=1.7)
    caption = "A ring within the upright line: what was stated agrees with how often it was right."
    return Chart("", "", (panel,), caption=caption)


def detection(rows: Sequence[CaseRow], score: Score) -> Chart:
    """Shares isolated against the gap, of the entrant, the oracle and BIC; and those noticed."""
    groups = [(span, own) for span, own in sized(rows) if own]
    labels = tuple(
        f"{low:g}–{high:g}\nn = {len(own)}" if np.isfinite(high) else f"> {low:g}\nn = {len(own)}"
        for (low, high), own in groups
    )
    named: tuple[tuple[str, str, Role], ...] = (
        (ORACLE, "oracle", "box"), ("bic", "BIC", "before"), (OURS, score.main, "measured"),
    )  # fmt: skip
    x = np.arange(len(groups))
    shown: dict[str, list[Series]] = {"isolated": [], "noticed": []}
    for method, name, role in named:
        if method != OURS and method not in score.beside:
            continue
        every = [shares(own, method)[:2] for _, own in groups]
        for k, what in enumerate(("noticed", "isolated")):
            series = shown[what]
            share = np.array([float(v[k] or 0.0) for v in every])
            series.append(Series(name, "line", x, 100 * share, role=role, dashed=method != OURS))
            if method == OURS:
                hits = [
                    (round(s * len(own)), len(own))
                    for s, (_, own) in zip(share, groups, strict=True)
                ]
                series.append(
                    Series(name, "points", x, 100 * share, role=role, ends=_ends(hits))
                )  # fmt: skip
    axis = Axis("gap that the effect adds", names=labels)
    panels = tuple(
        Panel(axis, _SHARE, tuple(series), title=what, height=1.4) for what, series in shown.items()
    )
    caption = "Isolated: a claimed class holds the effect. Noticed: any answer but none. "
    caption += f"Upright lines: 95 % intervals of {score.main}."
    return Chart("", "", panels, columns=2, caption=caption)


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
    rows, answers = score.rows, score.answers
    some = next(iter(answers.values()))
    kinds = Counter(r.kind for r in rows)
    counts = ", ".join(f"{kinds[k]} {k}" for k in ("single", "none", "outside", "pair"))
    left = (
        f" {score.unclaimed} cases have no claim: they count as wrong." if score.unclaimed else ""
    )
    head, lines = figure_cells(rows, [OURS, *score.beside], score.metrics, score.main)
    marks = zip(lines, score.metrics.values(), strict=True)
    lines = [_marked(cells, m, rows) for cells, m in marks]
    title = f"Sealed benchmark: {score.main} on {len(rows)} robots ({some.robot}, {some.mode})"
    about = (
        "The oracle is told the exact form and "
        "size of all that may be there; it names what the same data holds, with every effect "
        "that could imitate it there."
    )
    if score.is_semi_real:
        title = title.replace(f"{len(rows)} robots", f"{len(rows)} cases of a real recording")
        about = (
            f"The recording alone has a calibrated gap of {some.real_gap:.2f}. What is wrong in it "
            "nobody knows: only the added effects are held against the claims."
        )
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
    return Document(title, lead, sections, "", summary(score), data, tuple(_cards(score)))


def _cards(score: Score) -> Iterator[Card]:
    """Cards of the targets met, of single effects, and of cases without a library effect."""
    by_name = {k: (m, figure(m, score.rows, OURS)) for k, m in score.metrics.items()}
    judged = [(m, marked(m, scored)) for m, scored in by_name.values() if scored is not None]
    by_mark = {s: [m.title for m, mark in judged if mark == s] for s in ("✓", "(✓)", "(✗)", "✗")}
    met_ = len(by_mark["✓"]) + len(by_mark["(✓)"])
    total, open_ = sum(map(len, by_mark.values())), len(by_mark["(✓)"]) + len(by_mark["(✗)"])
    remark = f"For {open_} of them the cases are too few: the interval allows met and missed."
    if not open_:
        remark = "Every one of them beyond its 95 % interval."
    if by_mark["✗"]:
        remark += f" Missed for sure: {'; '.join(by_mark['✗'])}."
    yield Card("Targets", f"{met_} of {total} met", remark)
    scored = by_name["isolation"][1]
    if scored is not None:
        beside = [
            f"{name} {100 * other.value:.0f} %"
            for name in score.beside
            if (other := figure(by_name["isolation"][0], score.rows, name)) is not None
        ]
        also = f" Beside it: {', '.join(beside[:3])}." if beside else ""
        yield Card(
            "Effects that are there", f"{scored.counted} named",
            f"{_percent(scored)} of single effects that can be seen.{also}",
        )  # fmt: skip
    parts = [
        (scored, short, long)
        for k, short, long in (
            ("false_alarm", "false alarms", "of robots without a gap are called ill"),
            ("unknown", "called unknown", "of faults outside the library are called unknown"),
        )
        if k in by_name and (scored := by_name[k][1]) is not None
    ]
    if parts:
        large = ", ".join(f"{scored.counted} {short}" for scored, short, _ in parts)
        text = "; ".join(f"{_percent(scored)} {long}" for scored, _, long in parts)
        yield Card("Where none of them is", large, f"{text}.")


def _percent(scored: ScoredMetric) -> str:
    return f"{100 * scored.value:.0f} % ({100 * scored.low:.0f}–{100 * scored.high:.0f})"


def _marked(cells: Sequence[str], metric: Metric, rows: Sequence[CaseRow]) -> list[str]:
    """A line of the figures with ✓ or ✗ at its target, where it has one."""
    scored = figure(metric, rows, OURS)
    mark = "" if scored is None else f" {marked(metric, scored)}".rstrip()
    return [cells[0], f"{cells[1]}{mark}", *cells[2:]]


def marked(metric: Metric, scored: ScoredMetric) -> str:
    """✓ or ✗ at its target, in brackets where the interval allows the other; empty without one."""
    is_met = met(metric, scored.value)
    if is_met is None:
        return ""
    sign = "✓" if is_met else "✗"
    allowed = [met(metric, float(x)) for x in np.linspace(scored.low, scored.high, _STEPS)]
    exact = re.match(r"\d+ %$", metric.target)  # of the cases themselves
    return sign if exact or all(x is is_met for x in allowed) else f"({sign})"


def met(metric: Metric, value: float) -> bool | None:
    """Whether a figure meets its target; None without a target."""
    parts = re.fullmatch(r"([≥≤<>]?) ?([\d.]+)(?:–([\d.]+))?( %)?", metric.target)
    if parts is None:
        return None
    sign, low = parts[1], float(parts[2])
    shown = 100.0 * value if metric.percent else value
    if parts[3]:
        return low <= shown <= float(parts[3])
    return {
        "≥": shown >= low, ">": shown > low, "≤": shown <= low, "<": shown < low, "": shown == low
    }[sign]  # fmt: skip


def summary(score: Score) -> dict[str, object]:
    """Every figure by entrant and name: value, 95 % interval and count."""
    names = [OURS, *score.beside]
    result: dict[str, object] = {
        "cases": len(score.rows), "unclaimed": score.unclaimed, "commitments": score.root,
        "main": score.main,
    }  # fmt: skip
    for method in names:
        entries = {}
        for key, metric in score.metrics.items():
            scored = None if metric.ours and method != OURS else figure(metric, score.rows, method)
            if scored is not None:
                entries[key] = {
                    "value": scored.value, "ci95": [scored.low, scored.high], "n": scored.count,
                }  # fmt: skip
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
    said = [s for s in _ORDER if any(k[1] == s for k in counts)]
    lines = [
        [f"{t} ({sum(v for k, v in counts.items() if k[0] == t)})"]
        + [str(counts[(t, s)]) if counts[(t, s)] else "" for s in said]
        for t in _ORDER
        if any(k[0] == t for k in counts)
    ]
    return Table.of("True subsystem (down) and first answer (across)", ["", *said], lines)


def _outside(rows: Sequence[CaseRow]) -> Table:
    cases = [r for r in rows if r.kind == "outside"]
    lines = []
    for family in sorted({str(r.outside) for r in cases}):
        claims = [r.answers[OURS] for r in cases if r.outside == family]
        named = Counter(c.causes[0][0] for c in claims if c.causes)
        sure = sum(bool(c.causes) and c.sure > SURE for c in claims)
        lines.append(
            [
                family, len(claims), sum(c.verdict == "unknown" for c in claims),
                sum(c.verdict == "none" for c in claims), sure,
                ", ".join(f"{k} {v}" for k, v in named.most_common()) or "–",
            ]
        )  # fmt: skip
    head = ["family", "n", "unknown", "none", "named, p > 0.9", "named"]
    table = Table.of("Faults outside the library", head, lines)
    return replace(table, empty="No case has a fault outside the library.")


def _wrong(rows: Sequence[CaseRow]) -> Table:
    lines = []
    for row in rows:
        claim = row.answers[OURS]
        if right(row, claim):
            continue
        truth = ", ".join(row.truth) or row.outside or "none"
        said = "; ".join(" or ".join(c) for c in claim.causes) or claim.verdict
        size = max(row.size.values(), default=float("nan"))
        error = row.error.strip().split("\n")[-1][:80]
        lines.append([row.id, truth, size, said, claim.sure, error])
    head = ["case", "truth", "gap", "said", "p", "error"]
    table = Table.of("Wrong first answers", head, lines)
    return replace(table, empty="Every first answer is right.")
