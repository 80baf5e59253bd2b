"""How often claims are right at the design of one recording, learnt from look-alikes of it."""

import hashlib
import json
import os
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

import numpy as np

from wrenchbed.benchmark.lookalikes import ExperimentDesign, draw, recording
from wrenchbed.data.parquet import FORMAT
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.diagnose import weigh
from wrenchbed.diagnosis.explain import reliability
from wrenchbed.diagnosis.explain.reliability import Reliability, learnt, of_package, revision
from wrenchbed.diagnosis.prepare.prepare_recording import gathered
from wrenchbed.errors import DiagnosisError, ParameterError
from wrenchbed.jobs.parts import Journal, Row
from wrenchbed.jobs.workers import Progress, in_workers, silent

TEN_KINDS = ("single",) * 6 + ("none",) * 2 + ("outside",) * 1 + ("pair",) * 1
"""Kinds of ten successive cases."""
LEAST = 20
"""Fewest cases that anything can be learnt from: an estimate."""
_VERDICTS = ("none", "unknown")
"""Verdicts without a named cause."""
_SHARED: list[tuple[ExperimentDesign, int]] = []


def cache_folder() -> Path:
    """Folder of cached results: ``$XDG_CACHE_HOME`` or ``~/.cache``, in ``wrenchbed``."""
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "wrenchbed"


def reliability_at_design(
    at: Recording,
    count: int,
    *,
    seed: int = 0,
    processes: int = 2,
    cache: Path | None = None,
    report: Progress = silent,
) -> Reliability:
    """Learn how often claims are right from look-alikes of a recording.

    Args:
        at: recording whose poses, times, sensor and stated numbers the look-alikes share.
        count: cases; those in the cache are not computed again.
        seed: of the cases.
        processes: that work at the same time.
        cache: folder of results, `cache_folder` if None.
        report: called with the number of further cases that are done.

    Raises:
        DiagnosisError: too few cases, or none of them can be drawn at this design.
    """
    if count < LEAST:
        raise DiagnosisError(f"{count} look-alikes are too few: take at least {LEAST}")
    design = ExperimentDesign.of(at)
    journal = Journal((cache or cache_folder()) / f"look-alikes-{_key(design, seed)}.jsonl")
    known = {int(row["index"]): row for row in journal.read()}
    todo = [k for k in range(count) if k not in known]
    report(count - len(todo))

    def finished(index: int, future: Future[Row]) -> None:
        known[index] = future.result()
        journal.append(known[index])
        report(1)

    in_workers(_row_of, todo, finished, processes, _in_process, design, seed)
    rows = [row for k, row in sorted(known.items()) if k < count and row["raw"]]
    claims = [(row["features"], bool(row["right"])) for row in rows if row["named"]]
    none, unknown = (_right(rows, verdict) for verdict in _VERDICTS)
    prior = of_package(at)
    source = f"{len(rows)} look-alikes of this recording"
    other = prior is None or prior.elsewhere
    return replace(learnt(claims, none, unknown, source, prior), own=True, elsewhere=other)


def _right(rows: list[Row], verdict: str) -> tuple[int, int]:
    """Number of right verdicts of a kind without a named cause, and their total."""
    chosen = [row for row in rows if row["raw"] == verdict and not row["named"]]
    return sum(row["right"] for row in chosen), len(chosen)


def _in_process(design: ExperimentDesign, seed: int) -> None:
    _SHARED[:] = [(design, seed)]


def _row_of(index: int) -> Row:
    """Result of one look-alike's diagnosis."""
    design, seed = _SHARED[0]
    kind = TEN_KINDS[index % len(TEN_KINDS)]
    number = int(np.random.default_rng([seed, 70, index]).integers(2**40))
    row: Row = {"index": index, "kind": kind, "raw": "", "named": False, "right": False}
    try:
        case = draw(design, number, kind)
        rows = recording(design, case)
        weighed = weigh(gathered(rows), None, 0)
    except (ParameterError, DiagnosisError):  # no such case at this design, or refused data
        return row
    verdict, closed = weighed.decision.verdict, weighed.decision.gap.closed
    if verdict.causes:
        right = bool(set(verdict.causes[0].names) & set(case.causes))
    elif verdict.word == "none":
        right = case.outside is None and set(case.causes) <= set(case.rows)
    else:
        right = case.outside is not None
    answer = {"raw": verdict.word, "named": bool(verdict.causes), "right": right}
    closed_share = 0.0 if closed is None else closed.value
    known = reliability.features(weighed.analysis.ranking, verdict, closed_share)
    return row | answer | {"features": list(known)}


def _key(design: ExperimentDesign, seed: int) -> str:
    """Hash of a design and of what would change the cases."""
    text = json.dumps(design.metadata.to_json(), sort_keys=True, default=str)
    rows = (design.q, design.t, design.noise_std)
    data = b"".join(np.ascontiguousarray(x, dtype=float).tobytes() for x in rows)
    head = f"{FORMAT} {revision()} {seed} {design.samples} {design.rate} {text}".encode()
    return hashlib.sha256(head + data).hexdigest()[:20]
