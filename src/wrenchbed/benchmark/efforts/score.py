"""Figures of merit of answers about joint efforts, by the scorer of every benchmark."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from wrenchbed.benchmark.efforts.case import name_of
from wrenchbed.benchmark.scoring.case_rows import OURS, CaseRow, Claim
from wrenchbed.benchmark.scoring.metrics import METRICS, figure, markdown, right

SHOWN = ("isolation", "first", "unknown", "misnamed", "false_alarm", "sure",
         "seconds", "failed")  # fmt: skip
"""Names of the figures that are printed."""


@dataclass(frozen=True)
class Figure:
    """One line of the table: a figure with its 95 % interval."""

    name: str
    target: str
    value: float | None
    count: int
    text: str


def case_rows(rows: Sequence[Mapping[str, Any]], entrant: str) -> list[CaseRow]:
    """Rows of `entrants.answer` as the scorer's, with the claim of one entrant."""
    return [_row(row["id"], row["truth"], row["claims"][entrant]) for row in rows]


def _row(number: str, truth: Mapping[str, Any], claim: Mapping[str, Any]) -> CaseRow:
    cause, alike = name_of((truth["family"], truth["joint"])), set(map(name_of, truth["alike"]))
    causes = [tuple(c) for c in claim["causes"]]
    single = truth["kind"] == "library"
    if single:  # a class that begins with what no data of this motion tell apart is right
        causes = [(*c, cause) if c[0] in alike and cause not in c else c for c in causes]
    presence = tuple(claim["presence"])
    answer = Claim(claim["verdict"], tuple(causes), claim["probabilities"], presence)
    return CaseRow(
        number, "single" if single else str(truth["kind"]), (cause,) if single else (),
        str(truth["family"]) if truth["kind"] == "outside" else None,
        {cause: float(truth["gap"])}, {cause: float("inf")}, alike=tuple(sorted(alike)),
        answers={OURS: answer}, seconds={OURS: float(claim["seconds"])}, error=str(claim["error"]),
    )  # fmt: skip


def figures(rows: Sequence[CaseRow]) -> tuple[Figure, ...]:
    """The figures of one entrant."""
    result = []
    for metric in (METRICS[name] for name in SHOWN):
        scored = figure(metric, rows)
        value, count = (None, 0) if scored is None else (scored.value, scored.count)
        result.append(Figure(metric.title, metric.target, value, count, metric.text(scored)))
    return tuple(result)


def table(entrants: Mapping[str, Sequence[Figure]]) -> str:
    """Markdown table of all figures, with a column for each entrant."""
    lines = [
        [same[0].name, same[0].target, str(same[0].count), *(f.text for f in same)]
        for same in zip(*entrants.values(), strict=True)
    ]
    return markdown((["figure", "target", "cases", *entrants], lines))


def by_family(rows: Sequence[CaseRow]) -> str:
    """Markdown: how often each family is answered rightly, and what is said instead."""
    families: dict[str, list[CaseRow]] = {}
    for row in rows:
        families.setdefault(_family(row.outside or (row.truth or ("none",))[0]), []).append(row)
    lines = []
    for family, members in sorted(families.items()):
        wrong = [_said(row) for row in members if not right(row, row.answers[OURS])]
        instead = ", ".join(f"{w} ({wrong.count(w)})" for w in dict.fromkeys(wrong))
        lines.append([family, str(len(members)), str(len(members) - len(wrong)), instead])
    return markdown((["family", "cases", "right", "said instead"], lines))


def _said(row: CaseRow) -> str:
    claim = row.answers[OURS]
    return _family(claim.causes[0][0]) if claim.causes else claim.verdict


def _family(name: str) -> str:
    """Family of a fault's name, without the joint."""
    return name.rstrip("0123456789").rstrip(".")
