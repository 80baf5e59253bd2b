"""The score of a sealed benchmark: commitments checked, claims compared with answers.

Claims are read from the contract's ``diagnosis.json``.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wrenchbed.benchmark.scoring.truth_and_claims import OURS, CaseRow, Claim
from wrenchbed.benchmark.sealed import commitments
from wrenchbed.benchmark.sealed.commitments import MOST
from wrenchbed.benchmark.sealed.run import CLAIM, RESERVED, RUN
from wrenchbed.diagnosis.result import named_by
from wrenchbed.errors import BenchmarkError
from wrenchbed.files.checked import is_number, load

VERDICTS = ("none", "identified", "ambiguous", "partial", "unknown")
COUNTED = 4
"""Causes of a claim, and elements of a cause, that count: naming everything is no diagnosis."""
ORACLE = "oracle"
"""Name of the method that knows the true form and size."""
_BROKEN = (BenchmarkError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError)
"""Errors that reading a hostile file raises, for instance by numbers of 400 digits."""


def read(folder: Path, recording: str | None = None) -> Claim:
    """Read the claim of an entrant about one case; one that breaks the contract, or is about
    another recording (by SHA-256), counts as wrong."""
    if not folder.is_dir():
        return Claim(error="no claim")
    seconds, error = None, ""
    if (folder / RUN).is_file():
        try:
            about = load(folder / RUN, BenchmarkError)
            seconds, error = float(about["seconds"]), str(about["error"])
            if recording is not None and about.get("recording", recording) != recording:
                error = "the claim is about another case"
        except _BROKEN:
            error = f"{folder / RUN}: is broken"
    if error:
        return Claim(seconds=seconds, error=error)
    try:
        return _said(load(folder / CLAIM, BenchmarkError), seconds)
    except _BROKEN as cause:
        error = f"{folder / CLAIM}: breaks the contract: {cause!r}"
        return Claim(seconds=seconds, error=error)


def _said(raw: Mapping[str, Any], seconds: float | None) -> Claim:
    verdict = raw["verdict"]
    if verdict not in VERDICTS:
        raise ValueError(f"verdict {verdict!r} is none of {', '.join(VERDICTS)}")
    which = raw["which"]
    if bool(which) != (verdict in ("identified", "ambiguous", "partial")):
        raise ValueError(f"verdict {verdict!r} with {len(which)} causes")
    causes = tuple(_class(w) for w in which)
    presence = tuple(_probability(w["probability"]) for w in which)
    odds = {str(k): _probability(v) for k, v in raw["probabilities"].items()}
    crowded = [c for c in (*map(named_by, which), *(k.split("|") for k in odds)) if len(c) > MOST]
    if crowded:
        raise ValueError(f"the class of {crowded[0][0]} has more than {MOST} members")
    causes, presence = causes[:COUNTED], presence[:COUNTED]
    names = [n for c in causes for n in c]
    if len(set(names)) != len(names):
        raise ValueError(f"{max(names, key=names.count)} is named twice")
    if abs(sum(odds.values()) - 1.0) > 0.02:
        raise ValueError(f"probabilities sum to {sum(odds.values()):.3f}")
    where = raw.get("where") or []
    first = str(where[0]["subsystem"]) if where else None
    elements = {
        str(e["effect"]): tuple(map(str, e.get("elements") or ()))[:COUNTED]
        for w in which[:COUNTED]
        for e in (w, *w.get("rivals", ()))
        if isinstance(e, Mapping)
    }
    parameters = {str(w["effect"]): _numbers(w.get("parameters")) for w in which[:COUNTED]}
    gap = {k: x for k, v in _items(raw.get("gap")) if (x := _finite(v)) is not None}
    set90 = tuple(str(n) for n in raw.get("set90") or ())
    return Claim(verdict, causes, odds, presence, set90, first, elements, parameters, gap, seconds)


def _class(entry: Mapping[str, Any]) -> tuple[str, ...]:
    """Names of effects in an entry of diagnosis.json's ``which``; of drives, links with joints."""
    joint = dict(_items(entry.get("parameters"))).get("joint")
    joints = [""]
    if joint is not None:
        at = dict(_items(joint)) or {"value": joint}
        joints = [str(int(j)) for j in (at["value"], *at.get("rivals", ()))]
    members = [
        f"{n}.{j}" if n.startswith(("drive.", "link.")) and not n[-1].isdigit() else n
        for n in named_by(entry)
        for j in joints
    ]
    return tuple(n.rstrip(".") for n in dict.fromkeys(members))


def _numbers(raw: Any) -> dict[str, dict[str, float | None]]:
    """Published parameters with a finite value, by effect and name; other values are left out."""
    parameters = {}
    for name, p in _items(raw):
        value = _finite(dict(_items(p)).get("value"))
        if value is not None:
            std = _finite(dict(_items(p)).get("std"))
            known = std is not None and std >= 0
            parameters[name] = {"value": value, "std": std if known else None}
    return parameters


def _items(raw: Any) -> list[tuple[str, Any]]:
    return [(str(k), v) for k, v in raw.items()] if isinstance(raw, Mapping) else []


def _finite(raw: Any) -> float | None:
    return float(raw) if is_number(raw) else None


def _probability(value: Any) -> float:
    p = float(value)
    if not -1e-9 <= p <= 1.0 + 1e-9:
        raise ValueError(f"probability {value!r} is not between 0 and 1")
    return float(np.clip(p, 0.0, 1.0))


def entrants(claims: Path, main: str | None = None) -> list[str]:
    """Names of the entrants in a folder of claims, the main one first; a `BenchmarkError` if there
    is none, or not the one that was asked for."""
    names: list[str] = []
    if claims.is_dir():
        names = sorted(f.name for f in claims.iterdir() if f.is_dir() and f.name[0] != ".")
    taken = sorted(set(names) & set(RESERVED))
    if taken:
        raise BenchmarkError(f"{claims / taken[0]}: {taken[0]!r} is no name for an entrant")
    if not names:
        raise BenchmarkError(f"{claims}: holds no claims; `wrenchbed blind run` writes them")
    if main is not None and main not in names:
        raise BenchmarkError(f"{claims}: no entrant {main!r}; there are {', '.join(names)}")
    first = main or ("diagnose" if "diagnose" in names else names[0])
    return [first, *(n for n in names if n != first)]


@dataclass(frozen=True, eq=False)
class Score:
    """Answers and claims of all sealed cases: the entrant that is judged, whose claim is under
    `OURS`, the others by name, one row a case, the SHA-256 of the commitments, and how many cases
    the main entrant has no claim for."""

    main: str
    others: tuple[str, ...]
    rows: tuple[CaseRow, ...]
    root: str
    unclaimed: int

    @property
    def beside(self) -> tuple[str, ...]:
        """Names of methods shown beside the judged one; an oracle too if all cases have it."""
        known = all(row.truth.oracle is not None for row in self.rows)
        return (ORACLE, *self.others) if known else self.others


def score(
    cases: Path, claims: Path, answers: Path, main: str | None = None, published: str | None = None
) -> Score:
    """Check what was committed to, also against a published SHA-256, and compare claims (one folder
    an entrant) with answers; wrenchbed's diagnosis is judged if no other one is named, else the
    first entrant. A `BenchmarkError` if a case or an answer was changed, or claims are missing."""
    sealed = commitments.verify(cases, answers, published)
    names = entrants(claims, main)
    truths = {n: commitments.read_answer(commitments.answer_of(answers, n)) for n in sealed}
    wrong = next((n for n, a in truths.items() if a.case != n), None)
    if wrong is not None:
        path = commitments.answer_of(answers, wrong)
        raise BenchmarkError(f"{path}: answers case {truths[wrong].case}")
    rows, unclaimed = [], 0
    for name, truth in truths.items():
        methods = zip((OURS, *names[1:]), names, strict=True)
        said = {m: read(claims / n / name, sealed[name].recording) for m, n in methods}
        unclaimed += not (claims / names[0] / name).is_dir()
        if truth.oracle is not None:
            known = truth.oracle
            first = "|".join(known.causes[0]) if known.causes else known.verdict
            said[ORACLE] = Claim(known.verdict, known.causes, {first: 1.0})
        rows.append(CaseRow(truth, said))
    root = commitments.digest((cases / commitments.COMMITMENTS).read_bytes())
    return Score(names[0], tuple(names[1:]), tuple(rows), root, unclaimed)
