"""Learns how often claims are right at the design of one recording, from look-alikes of it."""

from concurrent.futures import Future
from functools import partial

import numpy as np

from wrenchbed.benchmark.lookalikes import ExperimentDesign, LookalikeCase, draw, recording
from wrenchbed.benchmark.scoring.truth_and_claims import numbers
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis import json_entries
from wrenchbed.diagnosis.decision.decide import conclude
from wrenchbed.diagnosis.diagnose import weigh
from wrenchbed.diagnosis.evidence.search import NONE, UNKNOWN
from wrenchbed.diagnosis.explain.familiarity import design_of
from wrenchbed.diagnosis.explain.reliability import (
    UNLEARNT,
    Lesson,
    Reliability,
    features,
    key_of,
    learnt,
    lessons,
)
from wrenchbed.diagnosis.prepare.prepare_recording import gathered
from wrenchbed.errors import DiagnosisError, ParameterError
from wrenchbed.jobs.workers import Progress, in_workers, silent

TEN_KINDS = ("single",) * 6 + ("none",) * 2 + ("outside",) * 1 + ("pair",) * 1
"""Kinds of ten successive cases."""
LEAST = 20
"""Fewest cases that anything can be learnt from: one half is then known to 0.11 (1 σ)."""


def reliability_at_design(
    at: Recording, count: int, *, seed: int = 0, processes: int = 2, report: Progress = silent
) -> Reliability:
    """Learn how often claims are right, from ``count`` look-alikes with the poses, times, sensor
    and stated numbers of a recording, and from the shipped lessons; a `DiagnosisError` for too
    few cases, or if none of them can be drawn at this design."""
    if count < LEAST:
        raise DiagnosisError(f"{count} look-alikes are too few: take at least {LEAST}")
    taught: dict[int, Lesson | None] = {}

    def finished(index: int, future: Future[Lesson | None]) -> None:
        taught[index] = future.result()
        report(1)

    teach = partial(lesson_at, ExperimentDesign.of(at), seed)
    in_workers(teach, range(count), finished, processes)
    at_design = [x for _, x in sorted(taught.items()) if x is not None]
    if not at_design:
        raise DiagnosisError("none of the look-alikes can be drawn at this design")
    source = f"{len(at_design)} look-alikes of this recording and {len(lessons())} other cases"
    return learnt([*lessons(), *at_design], source)


def lesson_at(design: ExperimentDesign, seed: int, index: int) -> Lesson | None:
    """Draw look-alike ``index`` of a seed; diagnose it: claim and truth, None without one."""
    kind = TEN_KINDS[index % len(TEN_KINDS)]
    number = int(np.random.default_rng([seed, 70, index]).integers(2**40))
    try:
        return lesson(design, draw(design, number, kind), f"{seed}-{index}")
    except (ParameterError, DiagnosisError):  # no such case at this design, or refused data
        return None


def lesson(design: ExperimentDesign, case: LookalikeCase, name: str, weight: float = 1.0) -> Lesson:
    """Diagnose a look-alike: claims, probabilities, truth, and errors of parameters over their
    standard uncertainties as a lesson of a ``name``, worth ``weight`` cases in learning
    reliability; a `DiagnosisError` if its data are refused."""
    weighed = weigh(gathered(recording(design, case)), UNLEARNT, 0)
    a, verdict, gap = weighed.analysis, weighed.decision.verdict, weighed.decision.gap
    mode = a.prepared.scene.mode
    claimed = features(verdict, gap.closed_least, gap.left, mode) if verdict.causes else ()
    final = conclude(weighed.decision, json_entries.elements_of(a, verdict))
    fitted = (
        numbers(entry["effect"], entry["parameters"], case.true_parameters(entry["effect"]))
        for entry in json_entries.causes(a, final, gap, 1.0, ())
        if entry["effect"] in case.causes
    )
    errors = tuple((n.value - n.truth) / n.std for some in fitted for n in some if n.std)
    probabilities = {k: p for k, p in verdict.probabilities.items() if p > 0.0}
    shown = set(case.causes) - set(case.rows)
    true = tuple(k for k in probabilities if shown & set(k.split("|")))
    if case.outside is not None or not shown:
        true = (NONE if case.outside is None else UNKNOWN,)
    return Lesson(
        design.robot.name.partition("@")[0], mode, name, claimed, key_of(verdict),
        true, probabilities, errors, design_of(a), weight,
    )  # fmt: skip
