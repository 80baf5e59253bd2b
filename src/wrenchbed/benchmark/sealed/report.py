"""The score as a page: Markdown and one HTML file.

Figures of a score: how far its probabilities hold, and how small an effect it finds.
"""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from wrenchbed.benchmark.scoring.case_rows import OURS, CaseRow
from wrenchbed.benchmark.scoring.metrics import (
    SURE,
    effect_cells,
    figure,
    figure_cells,
    right,
    shares,
    sized,
)
from wrenchbed.benchmark.sealed.score import ORACLE, Score, first
from wrenchbed.pages.document import Document, Figure, Section, Table
from wrenchbed.pages.plots import BLUE, GREY, ORANGE, PURPLE, canvas, to_svg

_BINS = np.array([0.0, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0 + 1e-9])


def reliability(rows: Sequence[CaseRow]) -> str:
    """Stated probability of first answers against the share that was right, with 90 % intervals."""
    stated = np.array([r.answers[OURS].sure for r in rows])
    held = np.array([right(r, r.answers[OURS]) for r in rows])
    which = np.digitize(stated, _BINS) - 1
    with canvas((4.6, 3.9)) as (figure, (ax,)):
        ax.plot([0, 100], [0, 100], color=GREY, lw=1.0, ls="--", label="as stated")
        for k in np.unique(which):
            own = held[which == k]
            n, share = len(own), float(own.mean())
            low, high = _interval(int(own.sum()), n)
            x = 100 * float(stated[which == k].mean())
            ax.plot([x, x], [100 * low, 100 * high], color=BLUE, lw=1.6)
            ax.plot(x, 100 * share, "o", color=BLUE, ms=6)
            ax.annotate(f"n = {n}", (x, 2), rotation=90, fontsize=7.5, color=GREY, ha="center")
        ax.plot([], [], "o", color=BLUE, ms=6, label="right, with 90 % interval")
        ax.set(xlim=(-3, 103), ylim=(0, 104), xlabel="stated [%]", ylabel="right [%]")
        ax.legend(loc="upper left")
        return to_svg(figure)


def detection(rows: Sequence[CaseRow], score: Score) -> str:
    """Shares noticed and isolated against the gap, of the entrant, the oracle and BIC."""
    groups = [(span, own) for span, own in sized(rows) if own]
    labels = [
        f"{low:g}–{high:g}\nn = {len(own)}" if np.isfinite(high) else f"> {low:g}\nn = {len(own)}"
        for (low, high), own in groups
    ]
    curves = [(OURS, score.main, BLUE)]
    named = ((ORACLE, "oracle", PURPLE), ("bic", "BIC", ORANGE))
    curves += [(m, name, colour) for m, name, colour in named if m in score.beside]
    with canvas((6.4, 3.9)) as (figure, (ax,)):
        for method, name, colour in curves:
            told = [shares(own, method) for _, own in groups]
            ax.plot(
                [100 * (t[1] or 0) for t in told],
                color=colour,
                marker="o",
                ms=5,
                label=f"{name}: isolated",
            )
            if method == OURS:
                ax.plot(
                    [100 * (t[0] or 0) for t in told], color=colour, marker="o", ms=5, mfc="none",
                    ls=":", label=f"{name}: noticed",
                )  # fmt: skip
        ax.set_xticks(range(len(labels)), labels, fontsize=8)
        ax.set(ylim=(-3, 104), xlabel="gap that the effect adds [1]", ylabel="share of cases [%]")
        ax.legend(loc="lower right")
        return to_svg(figure)


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


def page(score: Score) -> Document:
    """Every figure of a score.

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
            f"Intervals are 95 % by bootstrap over cases. {about}",
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
        f"that was committed to (SHA-256 of the commitments {score.root})."
    )
    return Document(title, lead, sections, "`wrenchbed blind score`", summary(score))


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
    return Table.of("Faults outside the library", head, told)


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
    return Table.of("Wrong first answers", head, told)
