"""Diagnose a recording: where the gap lies, which effect causes it, how far it shrinks."""

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from wrenchbed.calibration.checks.rows import contradicted
from wrenchbed.calibration.observations import observe
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis import json_entries
from wrenchbed.diagnosis.between_rows.row_effects import (
    VIBRATION,
    RowFinding,
    find_row_effects,
    find_tool_vibration,
    unexplained,
)
from wrenchbed.diagnosis.decision import rivals
from wrenchbed.diagnosis.decision.decide import (
    LARGEST_NONE,
    LEAST,
    beside_contact,
    beside_own_rest,
    conclude,
    confirmed,
    decide,
    withdrawn,
)
from wrenchbed.diagnosis.decision.facts import Decision, Facts, facts_of
from wrenchbed.diagnosis.evidence.search import PARTIAL, UNKNOWN
from wrenchbed.diagnosis.explain import outliers as outliers_
from wrenchbed.diagnosis.explain import unexplained_residual
from wrenchbed.diagnosis.explain.claims import Explanation
from wrenchbed.diagnosis.explain.contributions import made_by
from wrenchbed.diagnosis.explain.familiarity import design_of
from wrenchbed.diagnosis.explain.reliability import (
    NAMES,
    RIGHT_ELSEWHERE,
    Reliability,
    set90,
    shipped,
)
from wrenchbed.diagnosis.explain.structures import Analysis, analyse
from wrenchbed.diagnosis.explain.verdict import Verdict
from wrenchbed.diagnosis.gap import size_constancy, varies_with
from wrenchbed.diagnosis.gap.gap_bootstrap import Closure
from wrenchbed.diagnosis.gap.held_out import Claims, simulated
from wrenchbed.diagnosis.next import experiments
from wrenchbed.diagnosis.next.blind import Design, blind_spots
from wrenchbed.diagnosis.prepare.contact import CONTACT, contact_of
from wrenchbed.diagnosis.prepare.prepare_recording import prepare
from wrenchbed.diagnosis.prepare.prepared import Material, Prepared, Touch
from wrenchbed.diagnosis.result import Diagnosis
from wrenchbed.effects import sensor_jump, sensor_saturation
from wrenchbed.effects.base import per_channel
from wrenchbed.jobs.workers import one_thread
from wrenchbed.twin.twin import Twin

MOST_ROUNDS = 3
"""Largest number of passes that look for outliers: large ones hide others."""
LEFT = 1.0
"""Gap on held-out rows from which outliers are looked for although causes are named."""
MOST_SPELLS = 3
"""Most times at which rows disagree with all others under ``none``; more: an intermittent fault."""
OFTEN = "the rows set aside disagree at many times, each differently: an intermittent fault"
"""Note on a recording in which rows disagree at more times than a cause explains."""
AGAIN = "the rows set aside show the jump of the zero again: a fault that comes and goes"
"""Note on a recording whose zero jumps to and fro."""
LOUD = "there is a gap beyond the noise that no effect between rows explains"
"""Text on a gap that remains where no cause is named."""
PROBABLE = 0.8
"""Least probability of another cause beside a contact, which leaves few rows to separate causes;
below `RIGHT_ELSEWHERE`, the most that is believed of recordings unlike the learning cases."""
CLEARER = 0.3
"""Largest share of the remaining gap that an answer without outliers leaves; else they stay."""
UNLIKE = (
    ", which this recording is unlike: claims are believed to "
    f"{100.0 * RIGHT_ELSEWHERE:.0f} % at most, as on real robots"
)
"""Text on a recording unlike the cases from which the probabilities were learnt."""
Progress = Callable[[str], None]
"""Function that is called with the name of each step as it begins."""


@dataclass(frozen=True, eq=False)
class Findings:
    """A diagnosis with the analysis behind it.

    Attributes:
        diagnosis: the answers.
        analysis: linear and nonlinear analysis behind them.
        verdict: decision on the means of readings.
        rows: effects that show between rows only.
        places: what the calibrated residual varies with.
        plans: plans of the proposed experiments, by file name.
        scattered: sentence on row scatter beyond all that is named; empty if it is little.
        seed: random seed of the split into folds and of all permutations.
    """

    diagnosis: Diagnosis
    analysis: Analysis
    verdict: Verdict[Explanation]
    rows: tuple[RowFinding, ...]
    places: tuple[varies_with.Finding, ...]
    plans: Mapping[str, Plan]
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
    """Diagnose one recording: where the residual lies, which causes, how far, and what next.

    Args:
        recording: at rest or in motion.
        seed: random seed of the split into blocks and of all permutations.
        reliability: shares of claims that are right; by default the package's own model.
        material: residual that counts as a gap of 1; one row's noise if None.
        progress: called with the step that begins.

    Raises:
        DiagnosisError: these data allow no answer.
    """
    begun, known = time.perf_counter(), reliability or shipped()
    weighed = examine(recording, seed, known, progress, material)
    return findings_of(weighed, known, seed, progress, begun)


def examine(
    recording: Recording,
    seed: int,
    known: Reliability,
    progress: Progress,
    material: Material | None = None,
) -> "Weighed":
    """Decision on one recording by itself, outliers set aside, with effects that the row scatter
    shows; ``known``: learnt shares of claims that are right, others and errors as of `diagnose`."""
    progress("noise and blocks")
    prepared = prepare(recording, seed, material)
    progress("rows")
    between, scattered = _between_rows(prepared) if prepared.has_wrench else ((), "")
    prepared = _shaken(prepared, between)
    progress("effects and their evidence")
    weighed = _without_outliers(prepared, weigh(prepared, known, seed), known, seed)
    if weighed.outliers and prepared.has_wrench:
        between, scattered = _between_rows(weighed.analysis.prepared)
    return weighed._replace(between=between, scattered=scattered)


def _shaken(prepared: Prepared, between: Sequence[RowFinding]) -> Prepared:
    """Copy in which a vibration found between the rows of a motion of joints is noise."""
    for finding in between if prepared.moving else ():
        if finding.effect == VIBRATION:
            size = {name: p["value"] for name, p in finding.parameters.items()}
            amplitude = np.array([size[name] for name in per_channel("amplitude")])
            return prepared.shaking(amplitude, size.get("frequency"))
    return prepared


def _between_rows(prepared: Prepared) -> tuple[tuple[RowFinding, ...], str]:
    """Effects that only a wrench's row scatter shows, and a sentence on unexplained scatter.

    Rows that are no repeats of their pose, late or lost ones, scatter as if the base vibrated.
    """
    if not prepared.scene.moving and prepared.scene.mode == "static":
        used = observe(prepared.recording)
        finding = contradicted(prepared.recording, used.keep, used.count)
        if finding is not None:
            return (), finding.sentence
    rows, scatter = find_row_effects(prepared.excerpt, prepared.configuration)
    every, least = (*rows, *find_tool_vibration(prepared)), least_beside(prepared.touch)
    between = tuple(r for r in every if r.probability >= least)
    return between, unexplained(scatter, between)


def findings_of(
    weighed: "Weighed", known: Reliability, seed: int, progress: Progress, begun: float
) -> Findings:
    """Make the diagnosis of an examined recording; ``begun`` is the clock at its start [s]."""
    analysis, decision, outliers = weighed.analysis, weighed.decision, weighed.outliers
    between, scattered = weighed.between, weighed.scattered
    gap, twin, prepared = decision.gap, weighed.twin, analysis.prepared
    touch = _touch_of(weighed, outliers)
    often = OFTEN if touch is None and outliers_.spells(outliers) > MOST_SPELLS else ""
    loud = scattered or (LOUD if not between and gap.calibrated.low > LARGEST_NONE else "")
    signs = [sentence for sentence in (loud, often) if sentence]
    elements = json_entries.elements_of(analysis, decision.verdict)
    shown = [(r.effect, r.probability) for r in between]
    verdict = conclude(decision, elements, () if decision.verdict.causes else signs, shown)
    progress("where")
    places = varies_with.locate(prepared.leading, analysis.calibrated, seed=seed)
    unknown = verdict.word == UNKNOWN
    lying = varies_with.entries(
        json_entries.places(analysis, verdict, gap), places if unknown else (),
        [(r.effect, ", ".join(r.channels), r.rise / (1.0 + r.rise), 1.0 - r.probability)
         for r in between],
    )  # fmt: skip
    sensors = [("sensor", channel) for channel in gap.per_channel]
    hints = varies_with.of_channels(gap, sensors) if unknown else []
    progress("what next")
    said = (scattered, often, weighed.refuted)
    of_data = [*prepared.notes, *(sentence for sentence in said if sentence)]
    plans, proposed = _next(analysis, verdict, places, seed)
    mode = prepared.scene.mode
    here = known.believed_at(weighed.p_value, mode)
    spread, surest = here.spread, here.of((1.0,) * len(NAMES))
    unlike = UNLIKE if known.unlike(weighed.p_value, mode) else ""
    learnt = f"the probabilities were learnt on {known.source}{unlike}"
    which = json_entries.causes(analysis, verdict, gap, spread, between)
    others = " and ".join(c.name for c in prepared.channels[1:])
    held = [c.part.name for c in verdict.causes if confirmed(c, gap)]
    diagnosis = Diagnosis(
        recording=prepared.recording.name,
        robot=prepared.recording.metadata.robot,
        verdict=verdict.word,
        gap=gap,
        where=lying or hints,
        which=which if verdict.word in ("identified", "ambiguous", PARTIAL) else [],
        probabilities=verdict.probabilities,
        cannot_tell=json_entries.cannot_tell(which[: len(verdict.causes)], verdict.alike),
        blind=blind_spots(_designs(analysis)),
        next=proposed,
        twin=twin,
        between=[e for r in between if (e := r.active(prepared.robot)) is not None],
        seconds=time.perf_counter() - begun,
        set90=set90(verdict, known),
        minor=json_entries.minor(analysis, verdict, spread, surest),
        fitted=json_entries.fitted(analysis, verdict, spread),
        scale=json_entries.scales(*(x.prepared for x in (*analysis.others, analysis))),
        familiar=learnt,
        familiar_p=weighed.p_value,
        outliers=[o.entry(touch if prepared.touch is None else None) for o in outliers],
        notes=(
            *of_data,
            *json_entries.of_data(analysis, gap.folds),
            learnt,
            *json_entries.notes(gap, between, unknown=verdict.word == UNKNOWN),
            *(f"{name} is upheld by the {others} alone, on rows that no fit saw" for name in held),
        ),
    )
    if touch is not None:
        at_a_point = touch.parameters is not None
        both = beside_contact(verdict, CONTACT, touch.probability, gap, at_a_point=at_a_point)
        diagnosis = json_entries.with_contact(diagnosis, both, touch)
    return Findings(diagnosis, analysis, verdict, between, places, plans, scattered, seed)


class Weighed(NamedTuple):
    """Explanations of a recording, and the decision on the means of its readings.

    Attributes:
        twin: simulator with the causes; without any, with fitted bias, mass and CoG.
        p_value: conformal p-value that the recording is like the learning cases; of several the
            smallest times their number, at most 1; 0 where one has no wrench.
        refuted: sentence on a cause that comes nearest and is refuted; empty without one.
        outliers: observations that were set aside.
        between: effects that show between rows only.
        scattered: sentence on unexplained scatter between rows; empty without any.
    """

    analysis: Analysis
    decision: Decision[Explanation]
    twin: Twin
    p_value: float
    refuted: str = ""
    outliers: tuple[outliers_.Outlier, ...] = ()
    between: tuple[RowFinding, ...] = ()
    scattered: str = ""


def weigh(prepared: Prepared, known: Reliability, seed: int) -> Weighed:
    """Explain a gap; decide by held-out rows (``seed``: bootstrap) which causes may be claimed."""
    return settle(analyse(prepared), known, seed)


def settle(analysis: Analysis, known: Reliability, seed: int) -> Weighed:
    """Decide which causes of an analysis may be claimed, by rows that no fit used.

    A recording unlike the learning cases may have a residual of its own, which is then weighed as
    noise. For one like them the learnt probabilities already include such residuals.
    """
    each, p_value = (analysis, *analysis.others), 0.0
    mode = analysis.prepared.scene.mode
    if all(a.prepared.has_wrench for a in each):  # every lesson is of a wrench
        p_value = min(1.0, len(each) * min(known.p_value(mode, design_of(a)) for a in each))
    known = known.believed_at(p_value, mode)
    claims = Claims(analysis, seed)
    first = decide(facts(claims, known))
    if not known.unlike(p_value, mode) or not unexplained_residual.is_left(analysis):
        weighed = Weighed(analysis, first, claims.twin(first.verdict), p_value)
        f, names = first.verdict.explanation.finalist, {c.part.name for c in first.verdict.causes}
        grown = size_constancy.grown(analysis, f, _parts(first.verdict, names))
        change = _changing(analysis, first.verdict, names, seed) if grown >= LEAST else None
        return weighed if change is None else _refuted(weighed, change.sentence, seed)
    again = Claims(unexplained_residual.weighed_again(analysis), seed)

    def changing(verdict: Verdict[Explanation], names: Collection[str]) -> str:
        change = _changing(again.analysis, verdict, names, seed)
        return "" if change is None else change.sentence

    decision, refuted = beside_own_rest(
        first, lambda: decide(facts(again, known, own_rest=True)),
        lambda verdict: rivals.as_good(again.analysis, verdict, seed), changing,
    )  # fmt: skip
    first_stands = first.settled or decision is first
    used = claims if first_stands else again
    return Weighed(used.analysis, decision, used.twin(decision.verdict), p_value, refuted)


def facts(claims: Claims, known: Reliability, *, own_rest: bool = False) -> Facts[Explanation]:
    """Facts for a decision on means of readings; ``own_rest``: unexplained residual is noise."""
    a, least = claims.analysis, least_beside(claims.analysis.prepared.touch)

    def right(verdict: Verdict[Explanation], gap: Closure) -> float:
        return known.right(verdict, gap.closed_least, gap.left, a.prepared.scene.mode)

    seen = (sensor_saturation.EFFECT.name,) if a.prepared.at_limits.any() else ()
    known_facts = facts_of(a.ranking, claims.gap, right)
    return replace(known_facts, least=least, own_rest=own_rest, seen=seen)


def least_beside(touch: Touch | None) -> float:
    """Least probability of a cause beside a contact: 0 without one, ∞ if its force has no point."""
    if touch is None:
        return 0.0
    return PROBABLE if touch.parameters is not None else np.inf


def _changing(
    a: Analysis, verdict: Verdict[Explanation], names: Collection[str], seed: int
) -> size_constancy.Change | None:
    """Cause, claimed and in ``names``, whose size changes most surely; None if all are constant."""
    parts = _parts(verdict, names)
    return size_constancy.changing(a, verdict.explanation.finalist, parts, seed) if parts else None


def _parts(verdict: Verdict[Explanation], names: Collection[str]) -> list[int]:
    """Indices, in the fitted set of causes, of the claimed effects with these names."""
    claimed = [c.part.index for c in verdict.causes if c.part.name in names]
    return [k for k in claimed if k is not None]


def _refuted(weighed: Weighed, sentence: str, seed: int) -> Weighed:
    """Copy with the verdict ``unknown``, and the ``sentence`` on what refutes the causes."""
    claims = Claims(weighed.analysis, seed)
    verdict = withdrawn(weighed.decision.verdict, UNKNOWN)
    decision = Decision(verdict, claims.gap(verdict))
    return weighed._replace(decision=decision, twin=claims.twin(verdict), refuted=sentence)


def _without_outliers(prepared: Prepared, first: Weighed, known: Reliability, seed: int) -> Weighed:
    """Decision, after ``first`` on all rows, without rows that all others contradict."""
    weighed, outliers = first, tuple[outliers_.Outlier, ...]()
    for _ in range(MOST_ROUNDS):
        decision = weighed.decision
        if decision.settled and decision.gap.left < LEFT:
            break
        claim = Claims(weighed.analysis, seed).claimed(decision.verdict)
        named = None if claim is None or not decision.settled else claim.finalist
        found = _set_aside(prepared, weighed, outliers_.in_contact(weighed.analysis), known, seed)
        if found is None or _touch_of(*found) is None:
            rows = outliers_.suspects(weighed.analysis, named)
            found = _set_aside(prepared, weighed, rows, known, seed)
        if found is None:
            break
        weighed, outliers = found
    verdict, a = weighed.decision.verdict, weighed.analysis
    jumps, p = _parts(verdict, {sensor_jump.EFFECT.name}), a.prepared
    if jumps and p.has_wrench:
        made = made_by(a.refitter, verdict.explanation.finalist, jumps)
        made = made.reshape(a.dictionary.rows, -1)[:, p.families[0]]
        if outliers_.comes_again(outliers, made, p.leading.sigma):
            weighed = _refuted(weighed, AGAIN, seed)
    return weighed._replace(outliers=outliers)


def _set_aside(
    prepared: Prepared, first: Weighed, rows: np.ndarray, known: Reliability, seed: int
) -> tuple[Weighed, tuple[outliers_.Outlier, ...]] | None:
    """Decision without the observations of a mask ``rows`` (H,) and without those set aside before,
    and which of them do disagree; None if that is not clearer than the decision ``first``."""
    before = ~first.analysis.prepared.judged
    if not (rows & ~before).any():
        return None
    again = weigh(prepared.aside(rows | before), known, seed)
    outliers = outliers_.described(prepared, rows | before, simulated(prepared, again.twin))
    if not outliers or again.decision.gap.left > CLEARER * first.decision.gap.left:
        return None
    all_rows = np.any([o.rows for o in outliers], axis=0)
    if not np.array_equal(all_rows, rows | before):  # fewer: only what does disagree
        again = weigh(prepared.aside(all_rows), known, seed)
    return again, outliers


def _touch_of(weighed: Weighed, outliers: Sequence[outliers_.Outlier]) -> Touch | None:
    """Contact that outliers of a wrench are; None if they are none."""
    p = weighed.analysis.prepared
    if not (outliers and p.touch is None and p.has_wrench):
        return p.touch
    return contact_of(p, [o.rows for o in outliers], weighed.twin.wrench(p.scene))


def _designs(a: Analysis) -> list[Design]:
    """What each recording could show, one design a recording, for the search of blind spots."""
    best = a.ranking.explanations[0].finalist
    recordings = zip((a, *a.others), best.each or [best], strict=True)
    return [Design(x.searcher, f.rung) for x, f in recordings]


def _next(
    a: Analysis, verdict: Verdict[Explanation], places: Sequence[varies_with.Finding], seed: int
) -> tuple[dict[str, Plan], list[dict[str, Any]]]:
    """Plans of the proposed experiments by file name, and the entries of ``next``: for an unknown
    cause about the first of ``places``, or what a smooth function of the residual follows."""
    unknown = verdict.word == UNKNOWN
    rivals = [n for c in verdict.causes if len(c.names) > 1 for n in c.names]
    several = [c.elements[c.names[0]] for c in verdict.causes if c.open_elements]
    if not unknown and not rivals and not several:
        return {}, []
    fits = [fit for e in several for fit in zip(e.fits, e.parts, strict=True)]
    if unknown:
        follows = [f.variable for f in places if f.seen and f.share > 0.0]
        kernels = (v.partition(" between ")[0].partition(" of ")[0] for v in follows)
        each = (experiments.explore(a.dictionary.prepared, kernel, seed)
                for kernel in (*kernels, a.ranking.kernel))  # fmt: skip
        proposed = next(filter(None, each), ())
    else:
        candidates = (
            *experiments.candidates_of(a, rivals),
            *(experiments.candidate(f, k) for f, k in fits),
        )
        others = [o.dictionary.prepared for o in a.others]
        proposed = experiments.separate(a.dictionary, candidates, seed, others)
    plans: dict[str, Plan] = {}
    entries = []
    for k, e in enumerate(proposed):
        name = None
        if e.plan is not None:
            name = "next.parquet" if not plans else f"next-{k + 1}.parquet"
            plans[name] = e.plan
        entries.append(e.entry(name))
    return plans, entries
