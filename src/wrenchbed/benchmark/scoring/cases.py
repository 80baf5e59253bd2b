"""A benchmark's cases: designs and look-alikes from one seed, diagnosed by every method.

True parameters get the names that a diagnosis publishes, for effects whose numbers mean the same in
both physics. What the background of small imperfections adds to the same number belongs to the
truth: the robot has it.
"""

import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.benchmark.frame import STATED, attempts
from wrenchbed.benchmark.lookalikes import ExperimentDesign, LookalikeCase, draw, recording
from wrenchbed.benchmark.lookalikes.catalogue import EFFECTS
from wrenchbed.benchmark.lookalikes.loads import RigidLoad
from wrenchbed.benchmark.scoring.baselines import BASELINES, reuse_dictionary
from wrenchbed.benchmark.scoring.case_rows import OURS, CaseRow, Claim, Number, numbers
from wrenchbed.data.plan import Plan
from wrenchbed.diagnosis.diagnose import Findings, diagnose
from wrenchbed.diagnosis.explain import reliability
from wrenchbed.effects.chain import effects
from wrenchbed.errors import ParameterError
from wrenchbed.physics.wrench import CHANNELS
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


def truth(design: ExperimentDesign, case: LookalikeCase, effect: str) -> dict[str, float] | None:
    """True parameters of an effect, SI; what is not named is 0. None where forms differ."""
    if effect in STATED:
        return _stated(design, case, effect)
    drawn = EFFECTS.get(effect)
    if drawn is None or drawn.published is None:
        return None
    total: dict[str, float] = {}
    for item, share in case.items:
        if item.name == effect and (share == 1.0 or drawn.adds):
            for name, value in drawn.published(item.values).items():
                total[name] = total.get(name, 0.0) + share * value
    return total


def compared(
    design: ExperimentDesign,
    case: LookalikeCase,
    effect: str,
    published: Mapping[str, Mapping[str, Any]],
) -> tuple[list[Number], bool]:
    """Published parameters beside the true ones, and whether they hold all of the cause's."""
    true = truth(design, case, effect)
    if true is None:
        return [], False
    names = EFFECTS[effect].published
    needed = set(true if names is None else names(case.sizes[effect]))
    given = effects()[effect].amplitudes(published) or {}
    return numbers(effect, published, true), needed <= set(given)


def _stated(design: ExperimentDesign, case: LookalikeCase, effect: str) -> dict[str, float]:
    """Errors of a stated number, with what lies within its tolerance."""
    items = [(i, k) for i, k in case.items if i.name in (*STATED, "background")]
    if effect == STATED[0]:
        zero = np.zeros((1, 6))
        shifts = [k * i.sensor(zero)[0] for i, k in items if i.sensor is not None]
        total = np.sum(shifts, axis=0) if shifts else np.zeros(6)
        return {f"bias.{c}": float(v) for c, v in zip(CHANNELS, total, strict=True)}
    load: RigidLoad = design.load
    for item, _ in items:
        if item.tool is not None:
            load = item.tool(load, design.motion)
    if effect == STATED[1]:
        return {"mass": load.mass - design.load.mass}
    shift = load.cog - design.load.cog
    return {f"cog.{a}": float(v) for a, v in zip("xyz", shift, strict=True)}


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
    answers, seconds, errors = {}, {}, []
    results: list[Findings] = []

    def asked(name: str, method: Callable[[], Claim]) -> None:
        begun = time.perf_counter()
        try:
            answers[name] = method()
        except Exception:  # a benchmark goes on, and counts it
            errors.append(traceback.format_exc())
            answers[name] = Claim("error", (), {})
        seconds[name] = time.perf_counter() - begun

    def ours() -> Claim:
        results.append(diagnose(rows))
        return claim_of(results[0])

    asked(OURS, ours)
    if not results:
        answers |= {n: Claim("error", (), {}) for n in BASELINES}
    for name, baseline in BASELINES.items() if results else ():
        reuse_dictionary(results[0].analysis)
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
    return _with_findings(row, place, case, results[0]) if results else row


def _with_findings(
    row: CaseRow, place: ExperimentDesign, case: LookalikeCase, findings: Findings
) -> CaseRow:
    """A row with what the diagnosis says beside its claim, and what reliability is learnt from."""
    raw, diagnosis = findings.untempered, findings.diagnosis
    closed = diagnosis.gap.closed
    share = 0.0 if closed is None else closed.value
    parameters: list[Number] = []
    variant = True
    for cause in diagnosis.which:
        if cause["effect"] in case.causes:
            numbers, fits = compared(place, case, cause["effect"], cause["parameters"])
            parameters += numbers
            variant = variant and (fits or not numbers)
    return replace(
        row,
        where=diagnosis.where[0]["subsystem"] if diagnosis.where else None,
        numbers=tuple(parameters),
        variant=variant and bool(parameters),
        raw=raw.verdict,
        lead=raw.causes[0].names if raw.causes else (),
        features=reliability.features(findings.analysis.ranking, raw, share),
    )


def claim_of(findings: Findings) -> Claim:
    """Diagnosis as a claim, the form that all methods share."""
    diagnosis = findings.diagnosis
    causes = tuple((w["effect"], *w["rivals"]) for w in diagnosis.which)
    presence = tuple(float(w["probability"]) for w in diagnosis.which)
    return Claim(diagnosis.verdict, causes, dict(diagnosis.probabilities), presence)


def _detectability(place: ExperimentDesign, case: LookalikeCase) -> dict[str, float]:
    """Norm of each cause's signature [σ]; of a raised variance in its own scatter √(2/n)."""
    n = len(place)
    means = {k: float(np.sqrt(6 * n * g)) for k, g in case.gaps.items()}
    return means | {k: r * float(np.sqrt(n * place.samples / 2)) for k, r in case.rows.items()}
