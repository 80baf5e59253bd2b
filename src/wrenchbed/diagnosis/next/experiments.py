"""Which experiment would separate what a recording cannot, by the gain of a minute of it."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from wrenchbed.data.plan import Plan
from wrenchbed.diagnosis.evidence.dictionary import EffectDictionary
from wrenchbed.diagnosis.evidence.features import features
from wrenchbed.diagnosis.evidence.likelihood import LARGE, BackgroundLevel
from wrenchbed.diagnosis.explain.analysis import Analysis
from wrenchbed.diagnosis.explain.claims import stated
from wrenchbed.diagnosis.next.actions import (
    POSES,
    Action,
    Choose,
    ExperimentRun,
    actions,
    posed,
    static_noise,
)
from wrenchbed.diagnosis.next.discrimination import (
    GAP,
    Candidate,
    Comparison,
    ExperimentRows,
    jensen_shannon,
)
from wrenchbed.diagnosis.next.isolability import listed
from wrenchbed.diagnosis.prepare.prepared import Prepared

LEAST = 0.02
"""Divergence [nat] that an experiment must add to be worth proposing."""
SEPARATED = 0.1
"""… and that it must add to a pair to be said to separate it."""
MOST = 4
"""Explanations that are compared, experiments that are proposed."""
_AT_ONCE = 5


@dataclass(frozen=True, eq=False)
class Experiment:
    """A proposal.

    Attributes:
        action: what to do.
        separates: effects that it would separate, or the variable that it would show.
        gain: Jensen–Shannon divergence that it adds, mean over the pairs, per minute [nat/min].
        minutes: that it takes, moves and mounting included.
        plan: ready to record, None where there is nothing to plan.
        sentence: all of it for people.
    """

    action: str
    separates: tuple[str, ...]
    gain: float
    minutes: float
    plan: Plan | None
    sentence: str


def propose(
    analysis: Analysis, candidates: Sequence[Candidate], *, unknown: bool = False, seed: int = 0
) -> tuple[Experiment, ...]:
    """Experiments after a diagnosis, most telling a minute first.

    Args:
        candidates: explanations that remain with their amplitudes in typical sizes, best first.
        unknown: nothing of the library explains it: propose what shows on what it depends.
    """
    if unknown:
        ranking = analysis.ranking
        return explore(analysis.dictionary, ranking.kernel, max(ranking.gap, 1.0), seed)
    return separate(analysis.dictionary, candidates, seed)


def candidates_of(analysis: Analysis, names: Collection[str]) -> tuple[Candidate, ...]:
    """Of each effect the best explanation that it leads, with its fitted amplitudes."""
    chosen: dict[str, Candidate] = {}
    refitter, d = analysis.refitter, analysis.dictionary
    for e in analysis.ranking.explanations:
        for part in e.parts:
            if part.name not in names or part.name in chosen:
                continue
            if part.index is None:
                variants = [h for h in d.hypotheses if h.name == part.name]
                h = max(variants, key=lambda h: len(h.columns))
                mean = stated(refitter, e.finalist).mean
                place = {int(k): i for i, k in enumerate(d.stated)}
                chosen[part.name] = (h, np.array([mean[place[int(k)]] for k in h.columns]))
                continue
            f = e.finalist
            h, at = f.parts[part.index], f.variables.of_parts([part.index])
            size = {f.variables.name[i]: f.x[i] for i in at}
            chosen[part.name] = (h, np.array([size[n] for n in h.variant.free]))
    return tuple(chosen.values())


def separate(
    d: EffectDictionary, candidates: Sequence[Candidate], seed: int = 0
) -> tuple[Experiment, ...]:
    """Experiments that separate two or more explanations."""
    if len(candidates) < 2:
        return ()
    comparison = Comparison(d, candidates[:MOST])
    before = comparison.divergence([comparison.old])
    names = [h.name for h, _ in comparison.candidates]
    labels = [f"{h.name} ({h.variant.label})" for h, _ in comparison.candidates]
    proposed = []
    for action in actions(d.prepared, _chooser(comparison), seed, sweeps=1):
        after = comparison.divergence(_parts(comparison, action))
        added = {pair: after[pair] - before[pair] for pair in before}
        mean = float(np.mean(list(added.values())))
        pairs = [pair for pair, gain in added.items() if gain > SEPARATED]
        if mean < LEAST:
            continue
        best = max(added, key=lambda p: added[p])
        pairs = pairs or [best]
        apart = tuple(dict.fromkeys(names[k] for pair in pairs for k in pair))
        what = listed([f"{labels[a]} from {labels[b]}" for a, b in pairs])
        now, then = before[best], after[best]
        sentence = (
            f"{_capital(action.text)} ({action.minutes:.1f} min): it separates {what}; expected "
            f"divergence {now:.2f} → {then:.2f} of at most {np.log(2):.2f} nat."
        )
        gain = mean / action.minutes
        proposed.append(Experiment(action.text, apart, gain, action.minutes, action.plan, sentence))
    return tuple(sorted(proposed, key=lambda e: -e.gain)[:MOST])


def _parts(comparison: Comparison, action: Action) -> list[ExperimentRows]:
    rows = comparison.rows(action.session)
    return [rows] if action.session.again else [comparison.old, rows]


def _chooser(comparison: Comparison) -> Choose:
    """Poses at which the two leading explanations differ most, in steps."""

    def choose(pool: np.ndarray) -> np.ndarray:
        base = comparison.d.prepared
        t = 3.0 * np.arange(len(pool))
        rows = comparison.rows(ExperimentRun(posed(base, pool, t, static_noise(base), after=False)))
        chosen: list[int] = []
        parts = [comparison.old]
        while len(chosen) < min(POSES, len(pool)):
            score = comparison.contrast(parts, rows)
            score[chosen] = -1.0
            chosen += [int(k) for k in np.argsort(-score)[:_AT_ONCE]]
            take = (6 * np.array(chosen)[:, None] + np.arange(6)).ravel()
            parts = [comparison.old, ExperimentRows(rows.E[take], rows.v0[take])]
        return np.array(chosen[:POSES])

    return choose


def explore(
    d: EffectDictionary, kernel: str, gap: float = 4.0, seed: int = 0
) -> tuple[Experiment, ...]:
    """Experiments that show whether something unknown depends on a variable (a kernel's name).

    Args:
        gap: that the unknown adds.
    """
    before = _depends(d, d.prepared, kernel, gap)

    def choose(pool: np.ndarray) -> np.ndarray:
        return np.arange(len(pool))

    proposed = []
    for action in actions(d.prepared, choose, seed):
        if kernel not in action.variables:
            continue
        after = _depends(d, action.session.prepared, kernel, gap)
        gain = max(after - before, 0.0) / action.minutes
        sentence = (
            f"{_capital(action.text)} ({action.minutes:.1f} min): it shows whether what is left "
            f"depends on {kernel}."
        )
        proposed.append(
            Experiment(action.text, (kernel,), gain, action.minutes, action.plan, sentence)
        )
    return tuple(sorted(proposed, key=lambda e: (-e.gain, e.minutes))[:MOST])


def _depends(d: EffectDictionary, prepared: Prepared, kernel: str, gap: float) -> float:
    """Divergence [nat] between a dependence on one variable and all that the others can make."""
    groups = features(prepared)
    if kernel not in groups:
        return 0.0
    target = groups.pop(kernel)
    count = len(target)
    ones = np.tile(np.eye(6), (count // 6, 1))
    columns = np.concatenate([ones, *groups.values()], axis=1)
    variance = np.concatenate([np.full(6, LARGE), np.full(columns.shape[1] - 6, gap)])
    level = BackgroundLevel(columns, np.tile(prepared.variance + GAP, count // 6), variance)
    square = gap * float((target * level.solve(target)).sum())
    return jensen_shannon(float(np.sqrt(square / target.shape[1])))


def _capital(text: str) -> str:
    return text[0].upper() + text[1:]
