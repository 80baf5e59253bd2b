"""Look-alike cases from one seed, diagnosed by every method; reliability learnt at one design.

What the background of small imperfections adds to a number belongs to the truth: the robot has it.
"""

import hashlib
import json
import os
import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.benchmark.frame import attempts, true_numbers
from wrenchbed.benchmark.lookalikes import ExperimentDesign, LookalikeCase, draw, recording
from wrenchbed.benchmark.scoring.baselines import BASELINES
from wrenchbed.benchmark.scoring.case_rows import OURS, CaseRow, Claim, numbers
from wrenchbed.data.parquet import FORMAT
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.diagnose import Findings, diagnose, weigh
from wrenchbed.diagnosis.explain import reliability
from wrenchbed.diagnosis.explain.reliability import Reliability, learnt, of_package, revision
from wrenchbed.diagnosis.gap.result import named_by
from wrenchbed.diagnosis.prepare.prepare_recording import gathered
from wrenchbed.errors import DiagnosisError, ParameterError
from wrenchbed.jobs.parts import Journal, Row
from wrenchbed.jobs.workers import Progress, in_workers, silent
from wrenchbed.planning import choose

KINDS = ("single", "none", "outside", "pair")
"""Kinds in the order that seeds of cases follow from."""
POSES = (60, 100)
"""Fewest and most poses of a design at rest."""
SAMPLES, MOTION_S, RATE_HZ = 60, 60.0, 125.0
"""Rows of a pose; length of a motion [s] and its rate [Hz]."""
DESIGNS = {"static": 6, "dynamic": 3}
"""Number of designs over which the cases of a mode are spread."""
_TRIES = 8
"""Largest number of draws of a case."""
TEN_KINDS = ("single",) * 6 + ("none",) * 2 + ("outside",) * 1 + ("pair",) * 1
"""Kinds of ten successive cases."""
LEAST = 20
"""Fewest cases that anything can be learnt from: an estimate."""
_VERDICTS = ("none", "unknown")
"""Verdicts without a named cause."""
_SHARED: list[tuple[ExperimentDesign, int]] = []


def truth(case: LookalikeCase, effect: str) -> dict[str, float]:
    """True parameters of one of a case's effects by name, SI."""
    cause = next(item for item, _ in reversed(case.items) if item.name == effect)
    return true_numbers(cause, case.items)


@dataclass(frozen=True)
class BenchmarkSetting:
    """Benchmark setting: robot, mode of recording, and the seed that all cases follow from."""

    robot: str
    mode: str
    seed: int


@dataclass(frozen=True)
class Job:
    """Case ``index`` of a kind."""

    setting: BenchmarkSetting
    kind: str
    index: int

    @property
    def id(self) -> str:
        s = self.setting
        return f"{s.robot}-{s.mode}-{s.seed}-{self.kind}-{self.index}"

    @property
    def seed(self) -> int:
        """Seed of the case; the spacing leaves room for draws that show nothing."""
        state = (self.setting.seed, 60, KINDS.index(self.kind), self.index)
        return int(np.random.default_rng(state).integers(2**40)) * _TRIES


def jobs(setting: BenchmarkSetting, counts: Mapping[str, int]) -> Iterator[Job]:
    """All cases, with kinds mixed so that figures become exact together."""
    every = [(i / n, k, i) for k, n in counts.items() for i in range(n)]
    return (Job(setting, kind, index) for _, kind, index in sorted(every))


@lru_cache(maxsize=8)
def design(setting: BenchmarkSetting, number: int) -> ExperimentDesign:
    """Random poses, or a multisine, with the robot's nominal numbers stated."""
    robot = registry.load("robots", setting.robot)
    rng = np.random.default_rng([setting.seed, 61, number])
    if setting.mode == "dynamic":
        seed = int(rng.integers(2**31))
        return ExperimentDesign.of_plan(choose.multisine(robot, MOTION_S, RATE_HZ, seed), robot)
    q = robot.sample(int(rng.integers(POSES[0], POSES[1] + 1)), rng)
    return ExperimentDesign.of_plan(Plan.of(setting.robot, q), robot, samples=SAMPLES)


def of_job(job: Job) -> tuple[ExperimentDesign, LookalikeCase]:
    """Design and case of a job.

    Raises:
        ParameterError: nothing that was drawn shows enough.
    """
    place = design(job.setting, job.index % DESIGNS[job.setting.mode])
    return place, attempts(_TRIES, lambda k: draw(place, job.seed + k, job.kind), ParameterError)


def run(job: Job) -> CaseRow:
    """Draw a case and ask every method; what fails is an answer, too: a wrong one."""
    place, case = of_job(job)
    rows = recording(place, case)
    answers = dict.fromkeys((OURS, *BASELINES), Claim("error", (), {}))
    seconds: dict[str, float] = {}
    errors: list[str] = []
    results: list[Findings] = []

    def asked(name: str, method: Callable[[], Claim]) -> None:
        begun = time.perf_counter()
        try:
            answers[name] = method()
        except Exception:  # a benchmark goes on, and counts it
            errors.append(traceback.format_exc())
        seconds[name] = time.perf_counter() - begun

    def ours() -> Claim:
        results.append(diagnose(rows))
        return claim_of(results[0])

    asked(OURS, ours)
    for name, baseline in BASELINES.items() if results else ():
        asked(name, partial(baseline, results[0].analysis.prepared))
    row = CaseRow(
        id=job.id,
        kind=case.kind,
        truth=case.causes,
        outside=case.outside,
        size=dict(case.gaps),
        detectability=_detectability(place, case),
        between=tuple(case.rows),
        answers=answers,
        seconds=seconds,
        error="\n".join(errors),
    )
    return _with_findings(row, case, results[0]) if results else row


def _with_findings(row: CaseRow, case: LookalikeCase, findings: Findings) -> CaseRow:
    """A row with what the diagnosis says beside its claim, and what reliability is learnt from."""
    raw, diagnosis = findings.untempered, findings.diagnosis
    closed = diagnosis.gap.closed
    closed_share = 0.0 if closed is None else closed.value
    parameters = [
        number
        for cause in diagnosis.which
        if cause["effect"] in case.causes
        for number in numbers(cause["effect"], cause["parameters"], truth(case, cause["effect"]))
    ]
    return replace(
        row,
        where=diagnosis.where[0]["subsystem"] if diagnosis.where else None,
        numbers=tuple(parameters),
        raw=raw.word,
        lead=raw.causes[0].names if raw.causes else (),
        features=reliability.features(findings.analysis.ranking, raw, closed_share),
    )


def claim_of(findings: Findings) -> Claim:
    """Diagnosis as a claim, the form that all methods share."""
    diagnosis = findings.diagnosis
    causes = tuple(named_by(w) for w in diagnosis.which)
    presence = tuple(float(w["probability"]) for w in diagnosis.which)
    return Claim(diagnosis.verdict, causes, dict(diagnosis.probabilities), presence)


def _detectability(place: ExperimentDesign, case: LookalikeCase) -> dict[str, float]:
    """Norm of each cause's signature [σ]; of a raised variance in its own scatter √(2/n)."""
    n = len(place)
    means = {k: float(np.sqrt(6 * n * g)) for k, g in case.gaps.items()}
    return means | {k: r * float(np.sqrt(n * place.samples / 2)) for k, r in case.rows.items()}


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


def _row_of(index: int) -> dict[str, Any]:
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
