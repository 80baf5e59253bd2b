"""One case of a benchmark: what was true, what each method said, and how that is kept on disk."""

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from wrenchbed.benchmark.scoring.linear import Claim
from wrenchbed.errors import DiagnosisError
from wrenchbed.files import atomic_write

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
    return Claim(told["verdict"], causes, dict(told["probabilities"]), tuple(told["presence"]))


class Journal:
    """Rows of a benchmark on disk: one line a case, flushed at once, so that a kill loses none.

    Args:
        path: of the Parquet file that ``finish`` writes; lines go to ``path`` with ``.jsonl``.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.lines = path, path.with_suffix(".jsonl")
        self.path.parent.mkdir(parents=True, exist_ok=True)

    def read(self) -> list[CaseRow]:
        """Rows so far; a last line that a kill cut off is dropped from the file."""
        if not self.lines.exists():
            return read(self.path) if self.path.exists() else []
        whole = self.lines.read_bytes()
        end = whole.rfind(b"\n") + 1
        if end < len(whole):
            with self.lines.open("r+b") as file:
                file.truncate(end)
        return [from_json(json.loads(x)) for x in whole[:end].decode().splitlines()]

    def append(self, row: CaseRow) -> None:
        """Write a row so that it survives a kill at once."""
        with self.lines.open("a", encoding="utf-8") as file:
            file.write(json.dumps(to_json(row), ensure_ascii=False) + "\n")
            file.flush()
            os.fsync(file.fileno())

    def finish(self, rows: Iterable[CaseRow]) -> None:
        """Write the Parquet file, and delete the lines."""
        write(self.path, rows)
        self.lines.unlink(missing_ok=True)


def write(path: Path, rows: Iterable[CaseRow]) -> None:
    """Rows as Parquet, what is nested as JSON text."""
    told = []
    for row in rows:
        flat = to_json(row)
        told.append(flat | {k: json.dumps(flat[k], ensure_ascii=False) for k in _TEXT})
    with atomic_write(path) as temporary:
        pq.write_table(pa.Table.from_pylist(told, schema=_SCHEMA), temporary)


def read(path: Path) -> list[CaseRow]:
    """Rows of a Parquet file of ``write``."""
    table = pq.read_table(path).to_pylist()
    return [from_json(r | {k: json.loads(r[k]) for k in _TEXT}) for r in table]


_SCHEMA = pa.schema(
    [(name, pa.string()) for name in ("id", "kind", "outside", "where", "error", "raw", *_TEXT)]
    + [(name, pa.list_(pa.string())) for name in ("between", "lead")]
    + [("features", pa.list_(pa.float64())), ("variant", pa.bool_())]
    + [("closed", pa.float64()), ("oracle", pa.float64())]
)
