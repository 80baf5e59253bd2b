"""Diagnose a recording: where the gap lies, which effect causes it, how far it shrinks.

Causes as ``diagnosis.json`` tells them: parameters with their uncertainties.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.between_rows import rows
from wrenchbed.diagnosis.between_rows.averaged_motion import separate
from wrenchbed.diagnosis.between_rows.rows import RowFinding
from wrenchbed.diagnosis.evidence.dictionary import STATED
from wrenchbed.diagnosis.evidence.search import NONE, UNKNOWN
from wrenchbed.diagnosis.evidence.similarity import Likeness
from wrenchbed.diagnosis.explain import tilt
from wrenchbed.diagnosis.explain.analysis import Analysis, analyse
from wrenchbed.diagnosis.explain.claims import Explanation, stated
from wrenchbed.diagnosis.explain.reliability import Reliability, features, shipped
from wrenchbed.diagnosis.explain.verdict import Cause, Verdict, decide, tempered
from wrenchbed.diagnosis.gap import closure, where
from wrenchbed.diagnosis.gap.result import Diagnosis
from wrenchbed.diagnosis.next import experiments, isolability
from wrenchbed.diagnosis.prepare import scenes
from wrenchbed.diagnosis.prepare.prepared import Prepared
from wrenchbed.jobs.workers import one_thread

_HALVINGS = 5
"""Of the last step, to find the edge of a range within which nothing changes."""


def cause_entry(
    a: Analysis, verdict: Verdict, cause: Cause, gap: closure.Closure, spread: float
) -> dict[str, Any]:
    """One item of ``which``; ``spread`` multiplies standard uncertainties, see `Reliability`."""
    f = verdict.explanation.finalist
    name, *rivals = cause.names
    parameters: dict[str, Any]
    if cause.part.index is None:
        parameters = _wrong_numbers(a, verdict.explanation, name, spread)
    else:
        part = f.parts[cause.part.index]
        values = a.refitter.values(f.parts, f.x)[cause.part.index]
        std = _uncertainty(a, f, cause.part.index, spread)
        parameters = part.effect.publish(a.prepared.model.robot, part.variant, values, std)
    return {
        "effect": name,
        "probability": cause.probability,
        "rivals": rivals,
        "parameters": parameters,
        "closed_share": gap.shares.get(name),
    }


def _uncertainty(a: Analysis, f: Any, part: int, spread: float) -> dict[str, float]:
    """Standard uncertainties of a part's variables by name, SI; what its form may miss included."""
    robot = a.prepared.model.robot
    known = {p.name: p.tolerance for p in f.parts[part].effect.parameters(robot)}
    std = np.sqrt(np.maximum(np.diagonal(f.covariance), 0.0))
    effect = f.parts[part].effect
    variables = a.refitter.variables(f.parts)
    told = {}
    for i, (k, name, shape) in enumerate(variables):
        if k == part:
            form = 0.0 if shape else effect.size_error * float(f.x[i])
            flat = _flat(a, f, i) if shape and effect.rough else 0.0
            told[name] = (flat or float(np.hypot(spread * std[i], form))) * known[name]
    return told


def _flat(a: Analysis, f: Any, i: int) -> float:
    """Rms distance of a variable from where it might as well be: no reading changes in between.

    A jump may have come at any time between two poses.
    """
    reading, reach = a.refitter.response(f.parts, f.x), []

    def same(step: float) -> bool:
        x = f.x.copy()
        x[i] += step
        return bool(np.array_equal(a.refitter.response(f.parts, x), reading))

    for sign in (-1.0, 1.0):
        outside = next((s for s in 2.0 ** np.arange(-14, 1) if not same(sign * s)), 2.0)
        inside = outside / 2.0
        for _ in range(_HALVINGS):
            middle = (inside + outside) / 2.0
            inside, outside = (middle, outside) if same(sign * middle) else (inside, middle)
        reach.append(inside)
    left, right = reach
    if max(reach) <= 2.0**-14:  # nothing flat
        return 0.0
    return float(np.sqrt((left**2 - left * right + right**2) / 3.0))


def _wrong_numbers(a: Analysis, e: Explanation, name: str, factor: float) -> dict[str, Any]:
    """The errors of a stated number: what it should be more than what is stated."""
    d, told = a.dictionary, stated(a.refitter, e.finalist)
    std = np.sqrt(np.maximum(np.diagonal(told.covariance), 0.0))
    hypothesis = next(h for h in d.hypotheses if h.name == name)
    known = hypothesis.effect.parameters(a.prepared.model.robot)
    result = {}
    for i, k in enumerate(d.stated):
        effect, parameter = d.label[k]
        if effect == name:
            unit = known[known.index(parameter)].unit
            size = float(d.size[k])
            value, spread = float(told.mean[i]) * size, float(std[i]) * size * factor
            result[parameter] = {"value": value, "std": spread, "unit": unit}
    return result


def row_entry(r: RowFinding) -> dict[str, Any]:
    return {
        "effect": r.effect,
        "probability": r.probability,
        "rivals": [],
        "parameters": r.parameters,
        "closed_share": None,
    }


Progress = Callable[[str], None]
"""Called with the name of each step as it begins."""


@dataclass(frozen=True, eq=False)
class Findings:
    """A diagnosis with what it rests on.

    Attributes:
        diagnosis: the answers.
        analysis: linear and nonlinear analysis behind them.
        verdict: on the means of readings.
        untempered: the same before the reliability of such claims was weighed in.
        rows: what shows between rows only.
        places: where the calibrated residual lies.
        plans: of the proposed experiments, by file name.
    """

    diagnosis: Diagnosis
    analysis: Analysis
    verdict: Verdict
    rows: tuple[RowFinding, ...]
    places: tuple[where.Finding, ...]
    plans: Mapping[str, Plan]
    untempered: Verdict


@one_thread
def diagnose(
    recording: Recording,
    *,
    seed: int = 0,
    reliability: Reliability | None = None,
    progress: Progress = lambda _: None,
) -> Findings:
    """Where, which, how far, and what next.

    Args:
        recording: at rest or in motion.
        seed: of the split into blocks and of all permutations.
        reliability: how often claims are right, learnt at this recording's own design; the one
            that comes with the package if None.
        progress: told the step that begins.

    Raises:
        DiagnosisError: the data cannot answer, whatever the cause.
    """
    begun = time.perf_counter()
    progress("noise and blocks")
    whole, recording = recording, scenes.stretch(recording)
    prepared, apart = separate(recording, seed)
    progress("effects and their evidence")
    analysis = analyse(prepared)
    untempered = decide(analysis.ranking)
    known = reliability or _known(prepared)
    verdict = tilt.with_accelerometer(analysis, _tempered(analysis, untempered, known))
    progress("rows")
    part = scenes.excerpt(recording)
    shown = (*rows.find_row_effects(part), *apart.trembling)
    progress("where")
    places = where.locate(prepared, _calibrated(analysis), seed=seed)
    progress("how far")
    twin, gap = _twin(analysis, verdict, seed)
    progress("what next")
    likeness = Likeness(analysis.dictionary)
    named = {n for c in verdict.causes for n in c.names}
    cannot = isolability.cannot_tell(analysis.dictionary, likeness, named) if named else ()
    plans, then = _next(analysis, verdict, seed)
    spread = 1.0 if known is None else known.spread
    causes = [cause_entry(analysis, verdict, c, gap, spread) for c in verdict.causes]
    causes += [row_entry(r) for r in shown]
    outcome = verdict.verdict
    if shown and outcome == NONE:
        outcome = "identified"
    told = Diagnosis(
        recording=recording.name,
        robot=recording.metadata.robot,
        verdict=outcome,
        gap=gap,
        where=where.entries(
            _places(analysis, verdict, gap),
            places if outcome == UNKNOWN else (),
            [_row_place(r) for r in shown],
        ),
        which=causes if outcome in ("identified", "ambiguous") else [],
        probabilities=_leading(verdict, shown),
        cannot_tell=cannot,
        next=then,
        twin=twin,
        between=[a for r in shown if (a := r.active(prepared.model.robot)) is not None],
        seconds=time.perf_counter() - begun,
        notes=(
            *scenes.notes(whole, recording, part),
            *_notes(prepared, analysis, gap, shown, unknown=outcome == UNKNOWN),
            *tilt.sentences(analysis, verdict),
        ),
    )
    return Findings(apart.told(told), analysis, verdict, shown, places, plans, untempered)


def _known(prepared: Prepared) -> Reliability | None:
    """What ships with the package; of claims without joints only how often claims are right."""
    known = shipped(prepared.model.robot.name, prepared.moving)
    return known if known is None or prepared.scene.jointed else known.plain()


def _tempered(a: Analysis, verdict: Verdict, known: Reliability | None) -> Verdict:
    """The verdict with probabilities that hold, as far as look-alike cases can tell."""
    if known is None:
        return verdict
    if verdict.causes:
        return tempered(verdict, known.of(features(a.ranking, verdict)))
    return tempered(verdict, known.none if verdict.verdict == NONE else known.unknown)


def _calibrated(a: Analysis) -> np.ndarray:
    """Whitened residual (R, 6) after bias, mass and CoG."""
    basis = a.dictionary.fitted_away
    return np.asarray(a.refitter.y - basis @ (basis.T @ a.refitter.y)).reshape(-1, 6)


def _twin(a: Analysis, verdict: Verdict, seed: int) -> tuple[Any, closure.Closure]:
    """The better simulator, and how far it gets; without a claim it is the calibrated one."""
    e = verdict.explanation
    keep = [c.part.index for c in verdict.causes if c.part.index is not None]
    wrong = [c.names[0] for c in verdict.causes if c.part.index is None]
    if verdict.causes and len(keep) < sum(h.name not in STATED for h in e.finalist.parts):
        f, refitter = e.finalist, a.refitter
        parts = tuple(f.parts[k] for k in keep)
        own = [i for k in keep for i, (p, _, _) in enumerate(refitter.variables(f.parts)) if p == k]
        again = refitter.at(parts, f.rung, f.x[own], f.spread[own]) if parts else None
        chosen = again or refitter.nothing()
        keep = list(range(len(parts)))
    else:
        chosen = e.finalist
    if not verdict.causes:
        return closure.calibrated(a), closure.measure(a, None, (), seed)
    twin = closure.twin_of(a, chosen, keep)
    return twin, closure.measure(a, twin, wrong, seed)


def _places(
    a: Analysis, verdict: Verdict, gap: closure.Closure
) -> list[tuple[str, str, float, float]]:
    """(effect, detail, share, p-value) of each claim, for ``where``."""
    result = []
    told = a.ranking.explanations
    total = sum(c.part.share for c in verdict.causes) or 1.0
    for c in verdict.causes:
        without = [e.log_posterior for e in told if not e.names & set(c.names)]
        gain = verdict.explanation.log_posterior - max(
            without, default=verdict.explanation.log_posterior - 60.0
        )
        # a Bayes factor is an e-value, and 1/e a p-value: Vovk & Wang 2021, 10.1214/20-AOS2020
        p_value = float(np.exp(-max(gain, 0.0)))
        share = min(1.0, max(0.0, gap.shares.get(c.names[0], 0.0) or c.part.share / total))
        result.append((c.names[0], _detail(verdict, c), share, p_value))
    return result


def _row_place(r: RowFinding) -> tuple[str, str, float, float]:
    return r.effect, ", ".join(r.channels), r.rise / (1.0 + r.rise), 1.0 - r.probability


def _detail(verdict: Verdict, cause: Cause) -> str:
    if cause.part.index is None:
        return "a number that the metadata states"
    return verdict.explanation.finalist.parts[cause.part.index].variant.label


def _leading(verdict: Verdict, shown: Sequence[RowFinding]) -> dict[str, float]:
    """Probabilities of the leading cause; what shows between rows leads where nothing else does."""
    told = dict(verdict.probabilities)
    if shown and not verdict.causes:
        best = shown[0]
        spare = told.get(NONE, 0.0) * best.probability
        told[NONE] = told.get(NONE, 0.0) - spare
        told[best.effect] = told.get(best.effect, 0.0) + spare
    total = sum(told.values())
    return {k: v / total for k, v in told.items()}


def _next(a: Analysis, verdict: Verdict, seed: int) -> tuple[dict[str, Plan], list[dict[str, Any]]]:
    """Experiments, and their plans by file name."""
    unknown = verdict.verdict == UNKNOWN
    rivals = [n for c in verdict.causes if len(c.names) > 1 for n in c.names]
    if not unknown and not rivals:
        return {}, []
    candidates = experiments.candidates_of(a, rivals)
    found = experiments.propose(a, candidates, unknown=unknown, seed=seed)
    plans: dict[str, Plan] = {}
    told = []
    for k, e in enumerate(found):
        name = None
        if e.plan is not None:
            name = "next.parquet" if not plans else f"next-{k + 1}.parquet"
            plans[name] = e.plan
        told.append(
            {
                "action": e.action,
                "separates": list(e.separates),
                "gain": e.gain,
                "minutes": e.minutes,
                "plan": name,
                "sentence": e.sentence,
            }
        )
    return plans, told


LEFT = 0.2
"""Share of the calibrated gap that causes may leave without a word."""


def _notes(
    p: Prepared, a: Analysis, gap: closure.Closure, shown: Sequence[RowFinding], *, unknown: bool
) -> tuple[str, ...]:
    n, again = len(p.y), int(np.count_nonzero(p.count == 0))
    still = "poses" if p.recording.metadata.mode == "static" else "averages of a motion"
    what = "samples of motion" if p.moving else still
    told = [
        f"{n} {what}, {int(p.sealed.sum())} of them sealed; noise of a row {p.noise_told}",
    ]
    if p.left_out:
        told.append(f"{p.left_out} saturated rows were left out")
    if again:
        told.append(f"{again} rows that repeat the one before take no part")
    left = None if gap.with_effects is None else gap.with_effects - max(gap.floor, 0.0)
    if left is not None and left > max(1.0, LEFT * gap.calibrated):
        told.append(
            f"the named causes leave a gap of {left:.3g} on sealed rows: something else is wrong "
            "too, or their form is; do not trust the twin"
        )
    if a.dictionary.invisible:
        told.append("not visible in this data: " + ", ".join(a.dictionary.invisible))
    if shown and unknown:
        told.append(
            "what causes the gap of the means is unknown; beside it rows show "
            + ", ".join(f"{r.effect} (probability {r.probability:.2g})" for r in shown)
        )
    return (*told, *(r.sentence for r in shown))
