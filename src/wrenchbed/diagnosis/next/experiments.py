"""Which experiment would separate what a recording cannot tell, by what a minute of it is worth."""

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
    Contest,
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
        separates: effects that it would tell apart, or the variable that it would show.
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
    found: dict[str, Candidate] = {}
    refitter, d = analysis.refitter, analysis.dictionary
    for e in analysis.ranking.explanations:
        for part in e.parts:
            if part.name not in names or part.name in found:
                continue
            if part.index is None:
                own = [h for h in d.hypotheses if h.name == part.name]
                h = max(own, key=lambda h: len(h.columns))
                mean = stated(refitter, e.finalist).mean
                place = {int(k): i for i, k in enumerate(d.stated)}
                found[part.name] = (h, np.array([mean[place[int(k)]] for k in h.columns]))
                continue
            f = e.finalist
            h, at = f.parts[part.index], f.variables.of_parts([part.index])
            size = {f.variables.name[i]: f.x[i] for i in at}
            found[part.name] = (h, np.array([size[n] for n in h.variant.free]))
    return tuple(found.values())


def separate(
    d: EffectDictionary, candidates: Sequence[Candidate], seed: int = 0
) -> tuple[Experiment, ...]:
    """Experiments that tell two or more explanations apart."""
    if len(candidates) < 2:
        return ()
    contest = Contest(d, candidates[:MOST])
    before = contest.divergence([contest.old])
    names = [h.name for h, _ in contest.candidates]
    labels = [f"{h.name} ({h.variant.label})" for h, _ in contest.candidates]
    found = []
    for action in actions(d.prepared, _chooser(contest), seed, sweeps=1):
        after = contest.divergence(_parts(contest, action))
        added = {pair: after[pair] - before[pair] for pair in before}
        mean = float(np.mean(list(added.values())))
        told = [pair for pair, gain in added.items() if gain > SEPARATED]
        if mean < LEAST:
            continue
        best = max(added, key=lambda p: added[p])
        told = told or [best]
        apart = tuple(dict.fromkeys(names[k] for pair in told for k in pair))
        what = listed([f"{labels[a]} from {labels[b]}" for a, b in told])
        now, then = before[best], after[best]
        sentence = (
            f"{_capital(action.text)} ({action.minutes:.1f} min): it separates {what}; expected "
            f"divergence {now:.2f} → {then:.2f} of at most {np.log(2):.2f} nat."
        )
        gain = mean / action.minutes
        found.append(Experiment(action.text, apart, gain, action.minutes, action.plan, sentence))
    return tuple(sorted(found, key=lambda e: -e.gain)[:MOST])


def _parts(contest: Contest, action: Action) -> list[ExperimentRows]:
    rows = contest.rows(action.session)
    return [rows] if action.session.again else [contest.old, rows]


def _chooser(contest: Contest) -> Choose:
    """Poses at which the two leading explanations differ most, in steps."""

    def choose(pool: np.ndarray) -> np.ndarray:
        base = contest.d.prepared
        t = 3.0 * np.arange(len(pool))
        rows = contest.rows(ExperimentRun(posed(base, pool, t, static_noise(base), after=False)))
        chosen: list[int] = []
        parts = [contest.old]
        while len(chosen) < min(POSES, len(pool)):
            score = contest.contrast(parts, rows)
            score[chosen] = -1.0
            chosen += [int(k) for k in np.argsort(-score)[:_AT_ONCE]]
            take = (6 * np.array(chosen)[:, None] + np.arange(6)).ravel()
            parts = [contest.old, ExperimentRows(rows.E[take], rows.v0[take])]
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

    found = []
    for action in actions(d.prepared, choose, seed):
        if kernel not in action.variables:
            continue
        after = _depends(d, action.session.prepared, kernel, gap)
        gain = max(after - before, 0.0) / action.minutes
        sentence = (
            f"{_capital(action.text)} ({action.minutes:.1f} min): it shows whether what is left "
            f"depends on {kernel}."
        )
        found.append(
            Experiment(action.text, (kernel,), gain, action.minutes, action.plan, sentence)
        )
    return tuple(sorted(found, key=lambda e: (-e.gain, e.minutes))[:MOST])


def _depends(d: EffectDictionary, prepared: Prepared, kernel: str, gap: float) -> float:
    """Divergence [nat] between a dependence on one variable and all that the others can make."""
    groups = features(prepared)
    if kernel not in groups:
        return 0.0
    own = groups.pop(kernel)
    count = len(own)
    ones = np.tile(np.eye(6), (count // 6, 1))
    columns = np.concatenate([ones, *groups.values()], axis=1)
    variance = np.concatenate([np.full(6, LARGE), np.full(columns.shape[1] - 6, gap)])
    level = BackgroundLevel(columns, np.tile(prepared.variance + GAP, count // 6), variance)
    square = gap * float((own * level.solve(own)).sum())
    return jensen_shannon(float(np.sqrt(square / own.shape[1])))


def _capital(text: str) -> str:
    return text[0].upper() + text[1:]
