"""Figures of merit of answers about joint efforts, by the scorer of every benchmark."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from wrenchbed.benchmark.efforts.alike import SAME, Key
from wrenchbed.benchmark.scoring.case_rows import OURS, CaseRow, Claim
from wrenchbed.benchmark.scoring.metrics import SURE, Metric, figure, markdown, median, share

OF_ORACLE = 0.95
"""Share of what the oracle closes that is asked for, by definition."""
_KINDS = {"library": "single"}
"""Kind in a result row for each kind of efforts' cases whose name differs."""


@dataclass(frozen=True)
class Figure:
    """One line of the table: a share of cases with its exact 95 % interval, or a median."""

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


def case_rows(rows: Sequence[Mapping[str, Any]], entrant: str) -> list[CaseRow]:
    """Rows of `entrants.answer` as the scorer's, with the claim of one entrant."""
    return [_row(row["id"], row["truth"], row["claims"][entrant]) for row in rows]


def _row(number: str, truth: Mapping[str, Any], claim: Mapping[str, Any]) -> CaseRow:
    cause, kind = _name((truth["family"], truth["joint"])), str(truth["kind"])
    causes = tuple(tuple(map(_name, c)) for c in claim["causes"])
    odds = {"none": float(claim["none"]), "unknown": float(claim["unknown"])}
    answer = Claim(str(claim["verdict"]), causes, odds, tuple(claim["presence"]))
    before, oracle = float(truth["configured"]), float(truth["oracle"])
    closable = 1.0 - max(oracle, 0.0) / before if before > 0.5 else None
    closed = None
    if kind == "library" and closable is not None:
        own = claim["closed"] or 0.0
        closed = min(own / closable, 1.0) if closable > 0.0 else 1.0
    return CaseRow(
        number, _KINDS.get(kind, kind), (cause,) if kind == "library" else (),
        str(truth["family"]) if kind == "outside" else None, {cause: float(truth["gap"])},
        {cause: float(truth["background"]) - oracle},
        alike=tuple(map(_name, truth["alike"])), answers={OURS: answer}, closed=closed,
        oracle=closable, seconds={OURS: float(claim["seconds"])}, error=str(claim["error"]),
    )  # fmt: skip


def _name(key: Key) -> str:
    """Name ``drive.coulomb.2`` of an effect and its joint."""
    effect, joint = key
    return effect if joint is None else f"{effect}.{joint}"


def right(row: CaseRow, cause: Sequence[str]) -> bool:
    """Whether a claimed class names the cause: it holds it, or begins with one that is alike."""
    return bool(set(row.truth) & set(cause)) or cause[0] in row.alike


def isolated(row: CaseRow, claim: Claim) -> bool:
    """Whether any claimed class names the cause, with its joint."""
    return any(right(row, c) for c in claim.causes)


def correct(row: CaseRow, claim: Claim) -> bool:
    """Whether the first answer is right: its class, none or unknown."""
    if claim.causes:
        return row.kind == "single" and right(row, claim.causes[0])
    return claim.verdict == {"none": "none", "outside": "unknown"}.get(row.kind)


def _sure(row: CaseRow, claim: Claim) -> bool:
    """Whether the first answer has a probability above 0.9."""
    said = [claim.probabilities[v] for v in ("none", "unknown") if claim.verdict == v]
    return max([*claim.presence, *said, 0.0]) > SURE


def _of(kind: str) -> Callable[[CaseRow, Claim], bool]:
    return lambda row, claim: row.kind == kind


def _shown(row: CaseRow, claim: Claim) -> bool:
    """Whether an oracle that knows the cause closes more of the gap than ordinary errors do."""
    return row.kind == "single" and not row.detectability[row.truth[0]] <= SAME


def _false(row: CaseRow, method: str) -> tuple[int, int] | None:
    """Claimed classes that do not name a single fault, of all."""
    causes = row.answers[method].causes
    if row.kind != "single" or not causes:
        return None
    return sum(not right(row, c) for c in causes), len(causes)


def _closable(row: CaseRow, claim: Claim) -> bool:
    return row.closed is not None


METRICS: tuple[Metric, ...] = (
    share("cause named, with its joint", "≥ 93 %", _of("single"), isolated),
    share("… unless ordinary errors imitate it", "", _shown, isolated),
    share("`unknown` of families outside", "≥ 92 %", _of("outside"),
          lambda row, claim: claim.verdict == "unknown"),
    share("outside, named with p > 0.9", "≤ 5 %", _of("outside"),
          lambda row, claim: any(p > SURE for p in claim.presence)),
    share("`none` of healthy robots", "≥ 95 %", _of("none"),
          lambda row, claim: claim.verdict == "none"),
    share("healthy, any claim", "≤ 5 %", _of("none"), lambda row, claim: bool(claim.causes)),
    Metric("claims that are false, of single faults", "≤ 3 %", _false, exact=True),
    share("right where p > 0.9", "≥ 97 %", _sure, correct),
    share("closes ≥ 95 % of the oracle's gap", "", _closable,
          lambda row, claim: (row.closed or 0.0) >= OF_ORACLE),
    median("gap closed over the oracle's, median", "≥ 0.95", lambda row, method: row.closed),
    median("seconds a case, median", "", lambda row, method: row.seconds[method]),
    share("failed with an error", "0", lambda row, claim: True,
          lambda row, claim: bool(row.error)),
)  # fmt: skip


def figures(rows: Sequence[CaseRow]) -> tuple[Figure, ...]:
    """All figures of one entrant."""
    result = []
    for metric in METRICS:
        scored = figure(metric, rows)
        if scored is None:
            result.append(Figure(metric.title, metric.target, None, 0))
            continue
        ends = (scored.low, scored.high) if metric.percent else (None, None)
        result.append(Figure(metric.title, metric.target, scored.value, scored.count, *ends))
    return tuple(result)


def table(entrants: Mapping[str, Sequence[Figure]]) -> str:
    """Markdown table of all figures, with a column for each entrant."""
    columns = list(entrants.values())
    lines = [
        [first.name, first.target, str(first.count), *(column[k].text for column in columns)]
        for k, first in enumerate(columns[0])
    ]
    return markdown((["figure", "target", "cases", *entrants], lines))


def by_family(rows: Sequence[CaseRow]) -> str:
    """Markdown: how often each family is answered rightly, and what is said instead."""
    families: dict[str, list[CaseRow]] = {}
    for row in rows:
        name = row.outside or (row.truth or ("none",))[0]
        families.setdefault(name.rstrip("0123456789").rstrip("."), []).append(row)
    lines = []
    for family in sorted(families):
        members = families[family]
        wrong = [_said(row) for row in members if not _well(row)]
        frequent = sorted(set(wrong), key=wrong.count, reverse=True)[:4]
        instead = ", ".join(f"{w} ({wrong.count(w)})" for w in frequent)
        lines.append([family, str(len(members)), str(len(members) - len(wrong)), instead])
    return markdown((["family", "cases", "right", "said instead"], lines))


def _well(row: CaseRow) -> bool:
    claim = row.answers[OURS]
    return isolated(row, claim) if row.kind == "single" else correct(row, claim)


def _said(row: CaseRow) -> str:
    claim = row.answers[OURS]
    if row.error:
        return "error"
    return claim.causes[0][0].rstrip("0123456789").rstrip(".") if claim.causes else claim.verdict
