"""Figures of merit of answers about joint efforts, each with a 95 % interval of shares."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import median
from typing import TypeVar

from wrenchbed.benchmark.efforts.alike import SAME
from wrenchbed.benchmark.efforts.case import EffortTruth
from wrenchbed.benchmark.efforts.claims import EffortClaim
from wrenchbed.benchmark.scoring.metrics import exact_interval

T = TypeVar("T")
CERTAIN = 0.9
"""Probability above which an answer counts as sure, as in the wrench's score; by definition."""
OF_ORACLE = 0.95
"""Share of what the oracle closes that is asked for; by definition."""


@dataclass(frozen=True)
class Answered:
    """A case with one entrant's answer."""

    truth: EffortTruth
    claim: EffortClaim


@dataclass(frozen=True)
class Figure:
    """One line of the table: hits of cases, or a median."""

    name: str
    target: str
    value: float | None
    count: int
    low: float | None = None
    high: float | None = None

    @property
    def text(self) -> str:
        """The value as a table shows it."""
        if self.value is None:
            return "–"
        if self.low is None or self.high is None:
            return f"{self.value:.2f}"
        return f"{self.value:.0%} ({self.low:.0%} to {self.high:.0%})"


def right(truth: EffortTruth, cause: tuple[tuple[str, int | None], ...]) -> bool:
    """Whether a claimed class names the cause: it holds it, or begins with one that is alike."""
    return (truth.family, truth.joint) in cause or cause[0] in truth.alike


def imitated(truth: EffortTruth) -> bool:
    """Whether ordinary errors imitate a cause: knowing it, the oracle closes hardly more."""
    return truth.background - truth.oracle <= SAME


def isolated(row: Answered) -> bool:
    """Whether any claimed class names the cause, with its joint."""
    return any(right(row.truth, c) for c in row.claim.causes)


def sure(row: Answered) -> bool:
    """Whether what is said first with the highest probability is said surely."""
    c = row.claim
    return max([*c.presence, c.none * (c.verdict == "none"),
                c.unknown * (c.verdict == "unknown")]) > CERTAIN  # fmt: skip


def correct(row: Answered) -> bool:
    """Whether the first answer is right: its class, none or unknown."""
    if row.claim.causes:
        return row.truth.kind == "library" and right(row.truth, row.claim.causes[0])
    wanted = {"none": "none", "outside": "unknown"}.get(row.truth.kind)
    return row.claim.verdict == wanted


def figures(rows: Sequence[Answered]) -> tuple[Figure, ...]:
    """All figures of one entrant."""
    kind = {k: [r for r in rows if r.truth.kind == k] for k in ("none", "library", "outside")}
    library = kind["library"]
    said = [(r, c) for r in library for c in r.claim.causes]
    closed = [_of_oracle(r) for r in library if r.truth.closed is not None]
    met = [c >= OF_ORACLE for c in closed]
    return (
        _share("cause named, with its joint", "≥ 93 %", library, isolated),
        _share("… unless ordinary errors imitate it", "",
               [r for r in library if not imitated(r.truth)], isolated),
        _share("`unknown` of families outside", "≥ 92 %", kind["outside"],
               lambda r: r.claim.verdict == "unknown"),
        _share("outside, named with p > 0.9", "≤ 5 %", kind["outside"],
               lambda r: any(p > CERTAIN for p in r.claim.presence)),
        _share("`none` of healthy robots", "≥ 95 %", kind["none"],
               lambda r: r.claim.verdict == "none"),
        _share("healthy, any claim", "≤ 5 %", kind["none"], lambda r: bool(r.claim.causes)),
        _share("claims that are false, of single faults", "≤ 3 %", said,
               lambda pair: not right(pair[0].truth, pair[1])),
        _share("right where p > 0.9", "≥ 97 %", [r for r in rows if sure(r)], correct),
        _share("closes ≥ 95 % of the oracle's gap", "", met, bool),
        Figure("gap closed over the oracle's, median", "≥ 0.95",
               median(closed) if closed else None, len(closed)),
        Figure("seconds a case, median", "",
               median(r.claim.seconds for r in rows) if rows else None, len(rows)),
        _share("failed with an error", "0", rows, lambda r: bool(r.claim.error)),
    )  # fmt: skip


def _of_oracle(row: Answered) -> float:
    """Share of what the oracle closes that an answer closes by its own account, at most 1."""
    truth = row.truth.closed or 0.0
    return min((row.claim.closed or 0.0) / truth, 1.0) if truth > 0.0 else 1.0


def _share(name: str, target: str, cases: Sequence[T], hit: Callable[[T], bool]) -> Figure:
    hits = sum(hit(c) for c in cases)
    if not cases:
        return Figure(name, target, None, 0)
    return Figure(name, target, hits / len(cases), len(cases), *exact_interval(hits, len(cases)))


def table(entrants: dict[str, tuple[Figure, ...]]) -> str:
    """Markdown of all figures, an entrant a column."""
    names = list(entrants)
    lines = ["| figure | target | cases | " + " | ".join(names) + " |",
             "|---|---|---|" + "---|" * len(names)]  # fmt: skip
    for k, first in enumerate(entrants[names[0]]):
        cells = [entrants[n][k].text for n in names]
        lines.append(f"| {first.name} | {first.target} | {first.count} | {' | '.join(cells)} |")
    return "\n".join(lines)


def by_family(rows: Sequence[Answered]) -> str:
    """Markdown: how often each family is answered rightly, and what is said instead."""
    lines = ["| family | cases | right | said instead |", "|---|---|---|---|"]
    for family in sorted({r.truth.family for r in rows}):
        own = [r for r in rows if r.truth.family == family]
        hits = [r for r in own if (isolated(r) if r.truth.kind == "library" else correct(r))]
        wrong = [_said(r.claim) for r in own if r not in hits]
        told = ", ".join(
            f"{w} ({wrong.count(w)})" for w in sorted(set(wrong), key=wrong.count, reverse=True)[:4]
        )
        lines.append(f"| {family} | {len(own)} | {len(hits)} | {told} |")
    return "\n".join(lines)


def _said(claim: EffortClaim) -> str:
    if claim.error:
        return "error"
    return claim.causes[0][0][0] if claim.causes else claim.verdict
