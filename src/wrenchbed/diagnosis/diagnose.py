"""Diagnose a recording: where the gap lies, which effect causes it, how far it shrinks."""

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis import answer, beside_claims
from wrenchbed.diagnosis.between_rows import row_effects
from wrenchbed.diagnosis.between_rows.row_effects import RowFinding, find_row_effects
from wrenchbed.diagnosis.between_rows.tool_vibration import find_tool_vibration
from wrenchbed.diagnosis.evidence.search import NONE, UNKNOWN
from wrenchbed.diagnosis.evidence.similarity import Similarity
from wrenchbed.diagnosis.explain import outliers as outliers_
from wrenchbed.diagnosis.explain import own_rest, tilt
from wrenchbed.diagnosis.explain.reliability import (
    RIGHT_ELSEWHERE,
    Reliability,
    features,
    shipped,
)
from wrenchbed.diagnosis.explain.structures import Analysis, analyse
from wrenchbed.diagnosis.explain.touched_poses import contact_of
from wrenchbed.diagnosis.explain.verdict import Verdict, decide, tempered
from wrenchbed.diagnosis.gap import closure, constancy, rivals, where
from wrenchbed.diagnosis.gap.result import Diagnosis
from wrenchbed.diagnosis.gap.upheld import LARGEST_NONE, PARTIAL, upheld, withdrawn
from wrenchbed.diagnosis.next import experiments, isolability
from wrenchbed.diagnosis.next.blind import blind_spots
from wrenchbed.diagnosis.prepare.prepare_recording import prepare
from wrenchbed.diagnosis.prepare.prepared import Material, Prepared
from wrenchbed.jobs.workers import one_thread
from wrenchbed.twin.twin import Twin

MOST_ROUNDS = 3
"""Largest number of passes that look for outliers: large ones hide others."""
LEFT = 1.0
"""Gap on held-out rows from which outliers are looked for although causes are named."""
MOST_SPELLS = 3
"""Times at which something may disagree with all the rest where there is no cause: more often it
is a fault of its own; estimate."""
OFTEN = "the rows set aside disagree at many times, each differently: an intermittent fault"
"""Note on a recording in which rows disagree at more times than a cause explains."""
CLEARER = 0.3
"""Rows are set aside where the answer without them leaves less than this part of the gap."""
ELSEWHERE = (
    "the probabilities were learnt on other robots and other sets of poses; simulated robots like "
    "this one (--look-alikes 200) give probabilities for this recording"
)
"""Note on probabilities of a robot that nothing was learnt on."""
FAMILIAR = "the probabilities were learnt on robots of this kind and such sets of poses or motions"
"""Sentence on probabilities that were learnt for such a recording."""
Progress = Callable[[str], None]
"""Called with the name of each step as it begins."""


@dataclass(frozen=True, eq=False)
class Findings:
    """A diagnosis with the analysis that it follows from.

    Attributes:
        diagnosis: the answers.
        analysis: linear and nonlinear analysis behind them.
        verdict: on the means of readings.
        rows: effects that show between rows only.
        places: where the calibrated residual lies.
        plans: of the proposed experiments, by file name.
        untempered: the verdict that held-out rows uphold, before the reliability of such claims
            was weighed in.
        scattered: what rows scatter beyond noise and all that is named; empty if that is little.
        seed: of the split into folds and of all permutations.
    """

    diagnosis: Diagnosis
    analysis: Analysis
    verdict: Verdict
    rows: tuple[RowFinding, ...]
    places: tuple[where.Finding, ...]
    plans: Mapping[str, Plan]
    untempered: Verdict
    scattered: str = ""
    seed: int = 0

    def write(self, folder: str | Path) -> None:
        """Write ``diagnosis.json``, ``twin.json`` and the plans of the proposed experiments."""
        self.diagnosis.write(folder)
        for name, plan in self.plans.items():
            plan.write(Path(folder) / name)


@one_thread
def diagnose(
    recording: Recording,
    *,
    seed: int = 0,
    reliability: Reliability | None = None,
    material: Material | None = None,
    progress: Progress = lambda _: None,
) -> Findings:
    """Diagnosis of one recording: where the residual lies, which causes, how far, and what next.

    Args:
        recording: at rest or in motion.
        seed: of the split into blocks and of all permutations.
        reliability: how often claims are right, learnt at this recording's own design; the one
            that comes with the package if None.
        material: residual that counts as a gap of 1; one row's noise if None.
        progress: called with the step that begins.

    Raises:
        DiagnosisError: the data cannot answer, whatever the cause.
    """
    begun = time.perf_counter()
    examined = examine(recording, seed, reliability, progress, material)
    return findings_of(examined, seed, progress, begun)


class Examined(NamedTuple):
    """A recording with weighed explanations, outliers, and effects between rows.

    Attributes:
        known: how often claims are right.
        between: effects that show between rows only.
        scattered: what else scatters between rows, a sentence; empty if nothing does.
    """

    weighed: "Weighed"
    known: Reliability | None
    outliers: tuple[outliers_.Outlier, ...]
    between: tuple[RowFinding, ...]
    scattered: str


def examine(
    recording: Recording,
    seed: int,
    reliability: Reliability | None,
    progress: Progress,
    material: Material | None = None,
) -> Examined:
    """Analysis of a recording on its own; arguments and errors are those of `diagnose`."""
    progress("noise and blocks")
    prepared = prepare(recording, seed, material)
    progress("effects and their evidence")
    known = reliability or _shipped(prepared)
    weighed, outliers = _without_outliers(prepared, weigh(prepared, known, seed), known, seed)
    prepared = weighed.analysis.prepared
    progress("rows")
    rows = (
        *find_row_effects(prepared.excerpt, prepared.configuration),
        *find_tool_vibration(prepared),
    )
    between = answer.rows_beside_contact(rows, prepared.touch)
    scattered = row_effects.unexplained(prepared.excerpt, prepared.configuration, between)
    return Examined(weighed, known, outliers, between, scattered)


def findings_of(examined: Examined, seed: int, progress: Progress, begun: float) -> Findings:
    """Findings of a diagnosis from an examined recording; ``begun`` is the clock at its start
    [s]."""
    weighed, known, outliers, between, scattered = examined
    analysis, untempered, verdict, twin, gap, refuted = weighed
    prepared = analysis.prepared
    reading = twin.wrench(prepared.scene) if outliers else prepared.expected
    touch = prepared.touch or contact_of(prepared, outliers, reading)
    loud = bool(scattered) or (not between and gap.calibrated.low > LARGEST_NONE)
    often = touch is None and outliers_.spells(outliers) > MOST_SPELLS
    if (loud or often) and verdict.verdict == NONE:
        verdict = withdrawn(verdict, UNKNOWN)
    verdict = answer.with_elements(analysis, verdict)
    progress("where")
    places = where.locate(prepared, analysis.calibrated, seed=seed)
    progress("what next")
    named = {n for c in verdict.causes for n in c.names}
    similarities = [Similarity(x.dictionary, named) for x in (analysis, *analysis.others)]
    cannot_tell = _cannot_tell(similarities, [c.names for c in verdict.causes])
    said = (scattered, OFTEN if often else "", refuted)
    of_data = [*prepared.notes, *(sentence for sentence in said if sentence)]
    plans, proposed = _next(analysis, verdict, seed)
    outcome = "identified" if between and verdict.verdict == NONE else verdict.verdict
    spread = 1.0 if known is None else known.spread
    which = answer.causes(analysis, verdict, gap, spread, between)
    probabilities = answer.probabilities(verdict, between)
    diagnosis = Diagnosis(
        recording=prepared.recording.name,
        robot=prepared.recording.metadata.robot,
        verdict=outcome,
        gap=gap,
        where=where.entries(
            answer.places(analysis, verdict, gap),
            places if outcome == UNKNOWN else (),
            [answer.row_place(r) for r in between],
        ),
        which=which if outcome in ("identified", "ambiguous", PARTIAL) else [],
        probabilities=probabilities,
        cannot_tell=cannot_tell,
        blind=blind_spots(similarities),
        next=proposed,
        twin=twin,
        between=[e for r in between if (e := r.active(prepared.robot)) is not None],
        seconds=time.perf_counter() - begun,
        set90=answer.set90(verdict, probabilities, known),
        minor=beside_claims.minor(analysis, verdict, spread, 1.0 if known is None else known.right),
        fitted=beside_claims.fitted(analysis, verdict, spread),
        scale=answer.scales(prepared),
        familiar=" ".join(_learnt(known)) or FAMILIAR,
        outliers=[o.entry(touch if prepared.touch is None else None) for o in outliers],
        notes=(
            *of_data,
            *answer.of_data(analysis, gap.folds),
            *_learnt(known),
            *answer.notes(gap, between, unknown=outcome == UNKNOWN),
            *tilt.sentences(analysis, verdict),
        ),
    )
    diagnosis = answer.with_contact(diagnosis, touch)
    return Findings(
        diagnosis, analysis, verdict, between, places, plans, untempered, scattered, seed
    )


class Weighed(NamedTuple):
    """Everything that a verdict on the means of readings rests on.

    Attributes:
        refuted: what comes nearest and yet cannot be it, a sentence; empty if there is no such.
    """

    analysis: Analysis
    untempered: Verdict
    verdict: Verdict
    twin: Twin
    gap: closure.Closure
    refuted: str = ""

    @property
    def settled(self) -> bool:
        """Whether held-out rows uphold an answer that leaves no cause open."""
        return self.verdict.verdict in (NONE, "identified", "ambiguous")

    @property
    def rest(self) -> float:
        """Gap above the noise floor that the answer leaves on held-out rows."""
        return (self.gap.with_effects or self.gap.calibrated).value - max(self.gap.floor, 0.0)


def weigh(prepared: Prepared, known: Reliability | None, seed: int) -> Weighed:
    """Explain the gap, and hold the explanation against rows that no fit saw."""
    return settle(analyse(prepared), known, seed)


def settle(analysis: Analysis, known: Reliability | None, seed: int) -> Weighed:
    """Hold what best explains the gap against rows that no fit saw.

    A robot that the package knows nothing of may leave a rest of its own. Of the others look-alikes
    taught how often something unknown leaves one. No look-alike has such a rest, so that those of
    the recording do not say how often a cause beside one is right. A cause whose readings the rest
    goes with is not named.
    """
    first = _settled(analysis, decide(analysis.ranking), known, seed)
    if known is None or not known.elsewhere or not own_rest.is_left(analysis):
        return first
    again = own_rest.weighed_again(analysis)
    if first.settled:
        return first._replace(verdict=rivals.with_rivals(again, first.verdict, seed))
    second = _settled(again, own_rest.decided(again.ranking), known.plain(), seed)
    before, now = ({c.part.name for c in w.verdict.causes} for w in (first, second))
    if now <= before:
        return first
    change = _changing(again, second.verdict, now - before, seed)
    if change is not None:
        return first._replace(refuted=change.sentence)
    return second._replace(verdict=rivals.with_rivals(again, second.verdict, seed))


def _changing(
    a: Analysis, verdict: Verdict, names: Collection[str], seed: int
) -> constancy.Change | None:
    """Change of a named cause's size during the recording; None if all are constant."""
    claim = _claimed(a, verdict)
    assert claim is not None
    asked = set(names) - set(tilt.witnessed(a, verdict))  # that another sensor measured, stands
    parts = [k for k in claim.keep if claim.finalist.parts[k].name in asked]
    return constancy.changing(a, claim.finalist, parts, seed) if parts else None


def _settled(analysis: Analysis, decided: Verdict, known: Reliability | None, seed: int) -> Weighed:
    decided = tilt.with_accelerometer(analysis, decided)
    twin, gap, untempered = _judged(analysis, decided, seed)
    verdict = _tempered(analysis, untempered, known, gap)
    verdict = answer.beside_contact(verdict, analysis.prepared.touch)
    if len(verdict.causes) != len(untempered.causes):
        twin, gap, verdict = _judged(analysis, verdict, seed)
    return Weighed(analysis, untempered, verdict, twin, gap)


def _without_outliers(
    prepared: Prepared, first: Weighed, known: Reliability | None, seed: int
) -> tuple[Weighed, tuple[outliers_.Outlier, ...]]:
    """The answer without a few blocks that all others contradict, where that settles it."""
    weighed, outliers = first, tuple[outliers_.Outlier, ...]()
    for _ in range(MOST_ROUNDS):
        if weighed.settled and weighed.rest < LEFT:
            break
        claim = _claimed(weighed.analysis, weighed.verdict) if weighed.settled else None
        named = None if claim is None else claim.finalist
        rows = outliers_.suspects(weighed.analysis, named) | ~weighed.analysis.prepared.judged
        if np.array_equal(rows, ~weighed.analysis.prepared.judged):
            break
        again = weigh(prepared.aside(rows), known, seed)
        described = outliers_.described(prepared, rows, again.twin.wrench(prepared.scene))
        if not described or again.rest > CLEARER * weighed.rest:
            break
        outliers, all_rows = described, np.any([o.rows for o in described], axis=0)
        weighed = again
        if not np.array_equal(all_rows, rows):  # fewer: only what does disagree
            weighed = weigh(prepared.aside(all_rows), known, seed)
    return weighed, outliers


def _learnt(known: Reliability | None) -> tuple[str, ...]:
    """Note on the cases that the probabilities were learnt on, if not those of this robot's
    kind."""
    if known is not None and known.own:
        return (f"the probabilities were learnt on {known.source}",)
    return () if known is None or not known.elsewhere else (ELSEWHERE,)


def _shipped(prepared: Prepared) -> Reliability | None:
    """Reliability model shipped with the package for this robot and kind of recording."""
    return shipped(prepared.robot.name, prepared.moving, prepared.scene.jointed)


def _tempered(
    a: Analysis, verdict: Verdict, known: Reliability | None, gap: closure.Closure
) -> Verdict:
    """The verdict with probabilities that hold on look-alike cases.

    What a second sensor measured does not hang on how often wrenches alone are read rightly.
    """
    witnessed = tilt.witnessed(a, verdict)
    lead = verdict.causes[0].names if verdict.causes else witnessed
    if known is None or (witnessed and set(witnessed) & set(lead)):
        return verdict
    if verdict.causes:
        weighed_verdict = tempered(verdict, _right(a, verdict, known, gap))
        both = zip(weighed_verdict.causes, verdict.causes, strict=False)
        causes = (was if set(was.names) & set(witnessed) else c for c, was in both)
        return replace(weighed_verdict, causes=tuple(causes))
    return tempered(verdict, known.none if verdict.verdict == NONE else known.unknown)


def _right(a: Analysis, verdict: Verdict, known: Reliability, gap: closure.Closure) -> float:
    """Fraction of claims like this verdict's that are right.

    Where they surely leave a gap that counts, on a robot that the package knows nothing of, not
    more often than causes beside the rest of a real recording: few look-alikes leave one.
    """
    closed = 0.0 if gap.closed is None else gap.closed.value
    right = known.of(features(a.ranking, verdict, closed))
    left = 0.0 if gap.with_effects is None else gap.with_effects.low - max(gap.floor, 0.0)
    return min(right, RIGHT_ELSEWHERE) if known.elsewhere and left > LARGEST_NONE else right


def _judged(a: Analysis, verdict: Verdict, seed: int) -> tuple[Twin, closure.Closure, Verdict]:
    """The better simulator, how far it gets on held-out rows, and the verdict that these uphold."""
    witnessed = tilt.witnessed(a, verdict)
    while True:
        claim = _claimed(a, verdict)
        gap = closure.measure(a, claim, seed)
        held = upheld(verdict, gap, witnessed)
        if len(held.causes) == len(verdict.causes):
            return closure.calibrated(a) if claim is None else claim.twin, gap, held
        verdict = held


def _claimed(a: Analysis, verdict: Verdict) -> closure.Claimed | None:
    """Simulator with the causes of a verdict, None if it has none."""
    if not verdict.causes:
        return None
    f = verdict.explanation.finalist
    keep = [c.part.index for c in verdict.causes if c.part.index is not None]
    wrong = [c.names[0] for c in verdict.causes if c.part.index is None]
    if len(keep) < len(f.effects):  # what is not claimed is fitted away
        f, keep = a.refitter.keeping(f, keep), list(range(len(keep)))
    return closure.Claimed.of(a, f, keep, wrong)


def _cannot_tell(designs: Sequence[Similarity], classes: Collection[Collection[str]]) -> list[str]:
    """Sentences on classes of effects that none of the recordings distinguishes."""
    first, *others = [isolability.cannot_tell(s.d, s, classes) for s in designs]
    return [text for text in first if all(text in other for other in others)]


def _next(a: Analysis, verdict: Verdict, seed: int) -> tuple[dict[str, Plan], list[dict[str, Any]]]:
    """Plans of the proposed experiments by file name, and the entries of ``next``."""
    unknown = verdict.verdict == UNKNOWN
    rivals = [n for c in verdict.causes if len(c.names) > 1 for n in c.names]
    several = [c.elements[c.names[0]] for c in verdict.causes if c.open_elements]
    if not unknown and not rivals and not several:
        return {}, []
    fits = [fit for e in several for fit in zip(e.fits, e.parts, strict=True)]
    candidates = (
        *experiments.candidates_of(a, rivals),
        *(experiments.candidate(f, k) for f, k in fits),
    )
    plans: dict[str, Plan] = {}
    entries = []
    for k, e in enumerate(experiments.propose(a, candidates, unknown=unknown, seed=seed)):
        name = None
        if e.plan is not None:
            name = "next.parquet" if not plans else f"next-{k + 1}.parquet"
            plans[name] = e.plan
        entries.append(
            {
                "action": e.action,
                "separates": list(e.separates),
                "gain": e.gain,
                "minutes": e.minutes,
                "plan": name,
                "sentence": e.sentence,
            }
        )
    return plans, entries
