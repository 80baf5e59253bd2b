"""Cases of a benchmark on disk: the truth of each case, and what each method answered."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import pyarrow as pa

from wrenchbed.benchmark.scoring.linear_problem import Claim
from wrenchbed.errors import DiagnosisError
from wrenchbed.jobs.parts import Journal, read_table, write_table

OURS = "wrenchbed"
"""Name of the diagnosis among the methods."""
_TEXT = ("truth", "size", "detectability", "answers", "numbers", "seconds")


@dataclass(frozen=True)
class Number:
    """A published parameter with its standard uncertainty, and the true one, SI."""

    name: str
    value: float
    std: float
    truth: float


@dataclass(frozen=True)
class CaseRow:
    """One case.

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
        variant: whether these hold everything that is not zero in truth.
        closed, oracle: share of the held-out gap that the diagnosis closes, and what one closes
            that is told the effects.
        seconds: that each method took.
        error: what went wrong, empty if nothing did.
        raw: verdict on the means before reliability was weighed in.
        lead: class that it named first.
        features: of that claim, see ``reliability``.
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
    variant: bool = False
    closed: float | None = None
    oracle: float | None = None
    seconds: Mapping[str, float] = field(default_factory=dict)
    error: str = ""
    raw: str = ""
    lead: tuple[str, ...] = ()
    features: tuple[float, ...] = ()


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


def to_json(row: CaseRow) -> dict[str, Any]:
    """A row as JSON holds it."""
    return asdict(row)


def from_json(told: Mapping[str, Any]) -> CaseRow:
    """The row of ``to_json``."""
    answers = {k: _claim(v) for k, v in told["answers"].items()}
    numbers = tuple(Number(**n) for n in told["numbers"])
    names = {k: tuple(told[k]) for k in ("truth", "between", "lead", "features")}
    return CaseRow(**{**told, **names, "answers": answers, "numbers": numbers})


def _claim(told: Mapping[str, Any]) -> Claim:
    causes = tuple(tuple(c) for c in told["causes"])
    return Claim(
        told["verdict"], causes, dict(told["probabilities"]), tuple(told["presence"]),
        tuple(told.get("set90", ())),
    )  # fmt: skip


class CaseFile:
    """Rows of a benchmark in a Parquet file, and in a journal beside it while the benchmark runs.

    Args:
        path: of the Parquet file; the journal has the suffix ``.jsonl``.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.journal = path, Journal(path.with_suffix(".jsonl"))

    def read(self) -> list[CaseRow]:
        """Rows so far, of both files; each case once."""
        rows = read(self.path) if self.path.exists() else []
        rows += map(from_json, self.journal.read())
        return list({row.id: row for row in rows}.values())

    def append(self, row: CaseRow) -> None:
        """Write a row so that it survives a kill."""
        self.journal.append(to_json(row))

    def finish(self) -> None:
        """Write all rows to the Parquet file, and delete the journal."""
        write(self.path, self.read())
        self.journal.remove()


def write(path: Path, rows: Iterable[CaseRow]) -> None:
    """Write rows as Parquet; nested values are JSON text."""
    flat = [to_json(row) for row in rows]
    text = [{k: json.dumps(row[k], ensure_ascii=False) for k in _TEXT} for row in flat]
    table = pa.Table.from_pylist([f | t for f, t in zip(flat, text, strict=True)], schema=_SCHEMA)
    write_table(path, table)


def read(path: Path) -> list[CaseRow]:
    """Rows of a Parquet file of ``write``."""
    table = read_table(path).to_pylist()
    return [from_json(r | {k: json.loads(r[k]) for k in _TEXT}) for r in table]


_SCHEMA = pa.schema(
    [(name, pa.string()) for name in ("id", "kind", "outside", "where", "error", "raw", *_TEXT)]
    + [(name, pa.list_(pa.string())) for name in ("between", "lead")]
    + [("features", pa.list_(pa.float64())), ("variant", pa.bool_())]
    + [("closed", pa.float64()), ("oracle", pa.float64())]
)
