"""The score as a page: Markdown and one HTML file."""

from collections import Counter
from collections.abc import Sequence

from wrenchbed.blind import plots
from wrenchbed.blind.metrics import first, metrics
from wrenchbed.blind.scoring import Score
from wrenchbed.diagnosis.scoring import SURE, figure, right
from wrenchbed.diagnosis.scoring_rows import OURS, Row
from wrenchbed.diagnosis.scoring_tables import effect_cells, figure_cells
from wrenchbed.study.page import Figure, Page, Section, Table

_ORDER = (
    "none", "sensor", "mount", "tool", "cable", "joint", "link", "base", "timing", "environment",
    "unknown", "error",
)  # fmt: skip


def page(score: Score) -> Page:
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
    head, told = figure_cells(rows, [OURS, *score.beside], metrics(answers), score.main)
    title = f"Sealed benchmark: {score.main} on {len(rows)} robots ({some.robot}, {some.mode})"
    sections = (
        Section(
            "Figures",
            "Intervals are 95 % by bootstrap over cases. The oracle is told the exact form and "
            "size of all that may be there; it names what the same data holds, with every effect "
            "that could imitate it there.",
            (Table.of("Every figure", head, told),),
        ),
        Section(
            "What it says, and how often that is right",
            "Stated probability of the first answer against how often it was right; how often "
            "single effects are noticed and isolated, against the gap that they add.",
            (
                Figure("reliability", "Reliability", plots.reliability(rows)),
                Figure("detection", "Detection against size", plots.detection(rows, score)),
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
    return Page(title, lead, sections, "`wrenchbed blind score`", summary(score))


def summary(score: Score) -> dict[str, object]:
    """Every figure by entrant and name: value, 95 % interval and count."""
    names = [OURS, *score.beside]
    told: dict[str, object] = {
        "cases": len(score.rows), "unclaimed": score.unclaimed, "commitments": score.root,
        "main": score.main,
    }  # fmt: skip
    for method in names:
        own = {}
        for key, metric in metrics(score.answers).items():
            found = None if metric.ours and method != OURS else figure(metric, score.rows, method)
            if found is not None:
                own[key] = {
                    "value": found.value, "ci95": [found.low, found.high], "n": found.count,
                }  # fmt: skip
        told[score.main if method == OURS else method] = own
    return told


def _truth(row: Row, answer: str) -> str:
    """True subsystem; of two, the one that was answered."""
    if row.kind in ("none", "outside"):
        return "none" if row.kind == "none" else "unknown"
    own = [t.partition(".")[0] for t in row.truth]
    return answer if answer in own else own[0]


def _confusion(rows: Sequence[Row]) -> Table:
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


def _outside(rows: Sequence[Row]) -> Table:
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


def _wrong(rows: Sequence[Row]) -> Table:
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
