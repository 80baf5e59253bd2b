"""Reliability at a recording's own design: look-alikes of it, diagnosed, and kept on disk."""

import hashlib
import json
import os
from collections.abc import Callable
from concurrent.futures import as_completed
from pathlib import Path
from typing import Any

import numpy as np

from wrenchbed.benchmark.lookalikes import ExperimentDesign, draw
from wrenchbed.benchmark.lookalikes import recording as measured
from wrenchbed.data.parquet import FORMAT
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.explain import reliability
from wrenchbed.diagnosis.explain.analysis import analyse
from wrenchbed.diagnosis.explain.reliability import Reliability, learnt, shipped
from wrenchbed.diagnosis.explain.verdict import decide
from wrenchbed.diagnosis.prepare import orientations
from wrenchbed.diagnosis.prepare.prepared import prepare
from wrenchbed.errors import DiagnosisError, ParameterError
from wrenchbed.jobs.workers import workers

KINDS = ("single",) * 6 + ("none",) * 2 + ("outside",) * 1 + ("pair",) * 1
"""Kinds of ten cases in a row."""
LEAST = 20
"""Fewest cases that teach anything."""
Told = Callable[[int, int], None]
"""Called with cases done and in all."""


def folder() -> Path:
    """Where what was learnt is kept: ``$XDG_CACHE_HOME`` or ``~/.cache``, in ``wrenchbed``."""
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "wrenchbed"


def at_design_of(
    recording: Recording,
    count: int,
    *,
    seed: int = 0,
    processes: int = 2,
    cache: Path | None = None,
    told: Told = lambda done, total: None,
) -> Reliability:
    """Learn how often claims are right from look-alikes of a recording; each case is kept at once.

    Args:
        recording: whose poses, times, sensor and stated numbers the look-alikes share.
        count: cases; those that the cache holds already are not computed again.
        seed: of the cases.
        processes: that work at the same time.
        cache: folder for what was learnt, `folder` if None.
        told: how far it is.

    Raises:
        DiagnosisError: too few cases, or none of them can be drawn at this design.
    """
    if count < LEAST:
        raise DiagnosisError(f"{count} look-alikes teach nothing: take at least {LEAST}")
    design = ExperimentDesign.of(recording)
    path = (cache or folder()) / f"look-alikes-{_key(design, seed)}.jsonl"
    path.parent.mkdir(parents=True, exist_ok=True)
    known = _read(path)
    todo = [k for k in range(count) if k not in known]
    told(count - len(todo), count)
    if todo:
        with workers(processes, _begin, design, seed) as pool:
            waiting = [pool.submit(_case, k) for k in todo]
            for done, future in enumerate(as_completed(waiting), start=count - len(todo) + 1):
                row = future.result()
                known[row["index"]] = row
                with path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(row) + "\n")
                told(done, count)
    rows = [r for k, r in sorted(known.items()) if k < count and r["raw"]]
    claims = [(r["features"], bool(r["right"])) for r in rows if r["named"]]
    none, unknown = (
        (sum(r["right"] for r in own), len(own))
        for own in ([r for r in rows if r["raw"] == name and not r["named"]] for name in _ANSWERS)
    )
    start = shipped(recording.metadata.robot, recording.metadata.mode == "dynamic")
    return learnt(claims, none, unknown, f"{len(rows)} look-alikes of this recording", start)


_ANSWERS = ("none", "unknown")
_DESIGN: list[tuple[ExperimentDesign, int]] = []


def _begin(design: ExperimentDesign, seed: int) -> None:
    _DESIGN[:] = [(design, seed)]


def _case(index: int) -> dict[str, Any]:
    """One look-alike and what the diagnosis says of it."""
    design, seed = _DESIGN[0]
    kind = KINDS[index % len(KINDS)]
    number = int(np.random.default_rng([seed, 70, index]).integers(2**40))
    row: dict[str, Any] = {"index": index, "kind": kind, "raw": "", "named": False, "right": False}
    try:
        case = draw(design, number, kind)
        rows = measured(design, case)
        ready = orientations.prepare if orientations.applies(rows) else prepare
        analysis = analyse(ready(rows))
    except (ParameterError, DiagnosisError):  # no such case here, or data that are refused
        return row
    verdict = decide(analysis.ranking)
    between = set(case.rows)
    if verdict.causes:
        right = bool(set(verdict.causes[0].names) & set(case.causes))
    elif verdict.verdict == "none":
        right = case.outside is None and set(case.causes) <= between
    else:
        right = case.outside is not None
    told = reliability.features(analysis.ranking, verdict)
    more = {"raw": verdict.verdict, "named": bool(verdict.causes), "right": right}
    return row | more | {"features": list(told)}


def _key(design: ExperimentDesign, seed: int) -> str:
    """Fingerprint of a design and of what would change the cases."""
    text = json.dumps(design.metadata.to_json(), sort_keys=True, default=str)
    rows = (design.q, design.t, design.noise_std)
    data = b"".join(np.ascontiguousarray(x, dtype=float).tobytes() for x in rows)
    head = f"{FORMAT} {seed} {design.samples} {design.rate} {text}".encode()
    return hashlib.sha256(head + data).hexdigest()[:20]


def _read(path: Path) -> dict[int, dict[str, Any]]:
    """Cases by number; a line that a kill cut off is computed again."""
    found: dict[int, dict[str, Any]] = {}
    if path.exists():
        for line in path.read_text("utf-8").splitlines():
            try:
                row = json.loads(line)
            except json.JSONDecodeError:
                continue
            found[int(row["index"])] = row
    return found
