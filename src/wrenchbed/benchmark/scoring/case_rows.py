"""Cases of a benchmark on disk: the truth of each case, and what each method answered."""

import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import pyarrow as pa

from wrenchbed.benchmark.frame import EFFECTS
from wrenchbed.effects.chain import effects
from wrenchbed.errors import DiagnosisError
from wrenchbed.jobs.parts import Journal, read_table, write_table

OURS = "wrenchbed"
"""Name of the diagnosis among the methods."""
_TEXT = ("truth", "size", "detectability", "answers", "numbers", "seconds")
"""Names of the Parquet columns that hold JSON text."""
_SCHEMA = pa.schema(
    [(name, pa.string()) for name in ("id", "kind", "outside", "where", "error", "raw", *_TEXT)]
    + [(name, pa.list_(pa.string())) for name in ("between", "lead", "alike")]
    + [("features", pa.list_(pa.float64()))]
    + [(name, pa.float64()) for name in ("closed", "oracle", "real_gap")]
)


@dataclass(frozen=True)
class Claim:
    """Claim of a method about a recording.

    Attributes:
        verdict: ``none``, ``identified``, ``ambiguous``, ``partial`` or ``unknown``.
        causes: claimed classes, largest first, each its first choice and then its rivals.
        probabilities: over the leading answer; a class's key is its members joined by ``|``.
        presence: probability of each class to be there, where that is not its share as leading.
        set90: names that are said to hold the truth in 90 % of cases, none of who does not say.
    """

    verdict: str
    causes: tuple[tuple[str, ...], ...]
    probabilities: dict[str, float]
    presence: tuple[float, ...] = ()
    set90: tuple[str, ...] = ()

    @property
    def sure(self) -> float:
        """Stated probability of the first answer: its class, none or unknown."""
        if self.presence:
            return self.presence[0]
        first = "|".join(self.causes[0]) if self.causes else self.verdict
        return self.probabilities.get(first, 0.0)


@dataclass(frozen=True)
class Number:
    """A published parameter with its standard uncertainty, and the true one, SI."""

    name: str
    value: float
    std: float
    truth: float


def numbers(
    effect: str, published: Mapping[str, Mapping[str, Any]], true: Mapping[str, float]
) -> list[Number]:
    """Published parameters of an effect with an uncertainty, beside the true ones, 0 if unlisted.

    Only those that mean the same in the library and in the physics of the cases.

    Args:
        effect: its name.
        published: ``value`` and ``std`` by the parameter's name.
        true: SI.
    """
    pattern = EFFECTS[effect].compared if effect in EFFECTS else ""
    given = effects()[effect].amplitudes(published) if pattern else None
    return [
        Number(f"{effect}:{name}", float(p["value"]), float(p["std"]), true.get(name, 0.0))
        for name, p in (given or {}).items()
        if re.fullmatch(pattern, name) and p.get("std") is not None and math.isfinite(p["value"])
    ]


@dataclass(frozen=True)
class CaseRow:
    """Result row of one case.

    Attributes:
        id: of the case, unique in a benchmark.
        kind: ``none``, ``single``, ``pair`` or ``outside``.
        truth: the contract's names of the effects; empty for none and outside.
        outside: name of the family outside the library.
        size: what each cause adds to the gap; between rows, the mean rise of a row's variance.
        detectability: of each cause [σ]; norm of its signature over the noise of a row.
        between: causes that show between rows only.
        answers: claim of each method.
        where: first subsystem that the diagnosis names.
        numbers: parameters of the true effects as the diagnosis states them.
        closed, oracle: share of the held-out gap that the diagnosis closes, and what one closes
            that is told the effects.
        seconds: that each method took.
        error: what went wrong, empty if nothing did.
        raw: verdict on the means before reliability was weighed in.
        lead: class that it named first.
        features: of that claim, see ``reliability``.
        alike: effects that this very data cannot tell from the true ones.
        real_gap: calibrated gap of the recording that the cause was added to; None of other cases.
    """

    id: str
    kind: str
    truth: tuple[str, ...] = ()
    outside: str | None = None
    size: Mapping[str, float] = field(default_factory=dict)
    detectability: Mapping[str, float] = field(default_factory=dict)
    between: tuple[str, ...] = ()
    answers: Mapping[str, Claim] = field(default_factory=dict)
    where: str | None = None
    numbers: tuple[Number, ...] = ()
    closed: float | None = None
    oracle: float | None = None
    seconds: Mapping[str, float] = field(default_factory=dict)
    error: str = ""
    raw: str = ""
    lead: tuple[str, ...] = ()
    features: tuple[float, ...] = ()
    alike: tuple[str, ...] = ()
    real_gap: float | None = None


def unique(rows: Sequence[CaseRow]) -> None:
    """Refuse rows that count a case twice.

    Raises:
        DiagnosisError: names the case.
    """
    seen: set[str] = set()
    for row in rows:
        if row.id in seen:
            raise DiagnosisError(f"case {row.id} is there twice: each case counts once")
        seen.add(row.id)


def from_json(raw: Mapping[str, Any]) -> CaseRow:
    """The row that ``dataclasses.asdict`` made ``raw`` of."""
    lists = {k: tuple(raw.get(k) or ()) for k in ("truth", "between", "lead", "features", "alike")}
    answers = {k: _claim(v) for k, v in raw["answers"].items()}
    parameters = tuple(Number(**n) for n in raw["numbers"])
    return CaseRow(**{**raw, **lists, "answers": answers, "numbers": parameters})


def _claim(raw: Mapping[str, Any]) -> Claim:
    lists = {k: tuple(raw.get(k, ())) for k in ("presence", "set90")}
    causes = tuple(tuple(c) for c in raw["causes"])
    return Claim(**{**raw, **lists, "causes": causes, "probabilities": dict(raw["probabilities"])})


class CaseFile:
    """Rows of a benchmark in a Parquet file, and in a journal beside it while the benchmark runs.

    Args:
        path: of the Parquet file; the journal has the suffix ``.jsonl``.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.journal = path, Journal(path.with_suffix(".jsonl"))

    def read(self) -> list[CaseRow]:
        """Rows written so far, from both files; each case once."""
        rows = read(self.path) if self.path.exists() else []
        rows += map(from_json, self.journal.read())
        return list({row.id: row for row in rows}.values())

    def append(self, row: CaseRow) -> None:
        """Write a row so that it survives a kill."""
        self.journal.append(asdict(row))

    def finish(self) -> None:
        """Write all rows to the Parquet file, and delete the journal."""
        write(self.path, self.read())
        self.journal.remove()


def write(path: Path, rows: Iterable[CaseRow]) -> None:
    """Write rows as Parquet; nested values are JSON text."""
    flat = [asdict(row) for row in rows]
    text = [{k: json.dumps(row[k], ensure_ascii=False) for k in _TEXT} for row in flat]
    table = pa.Table.from_pylist([f | t for f, t in zip(flat, text, strict=True)], schema=_SCHEMA)
    write_table(path, table)


def read(path: Path) -> list[CaseRow]:
    """Rows of a Parquet file that `write` made."""
    table = read_table(path).to_pylist()
    return [from_json(r | {k: json.loads(r[k]) for k in _TEXT}) for r in table]
