"""Which experiment would separate what a recording cannot, by its gain per minute.

Explanations are linear about the baseline: each predicts columns times sizes. In the covariance of
a rival, with all that the rival, the stated numbers and a normal background can make, the other's
predicted readings lie d standard deviations away. Two Gaussians so far apart have the
Jensen–Shannon divergence that the experiment is worth (Lin 1991, doi 10.1109/18.61115; its use for
designs: Vanlier et al. 2014, doi 10.1186/1752-0509-8-20).
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, fields
from itertools import combinations
from typing import Any

import numpy as np
from scipy.special import ndtr

from wrenchbed.channels.readings_with_effects import Response
from wrenchbed.data.plan import Plan
from wrenchbed.diagnosis.evidence.dictionary import EffectDictionary, Hypothesis, nuisance
from wrenchbed.diagnosis.evidence.likelihood import LARGE, MOST, BackgroundLevel, row_variance
from wrenchbed.diagnosis.explain.claims import stated
from wrenchbed.diagnosis.explain.elements import element, listed
from wrenchbed.diagnosis.explain.finalist import Finalist
from wrenchbed.diagnosis.explain.structures import Analysis
from wrenchbed.diagnosis.next.actions import Action, ExperimentRun, actions, loaded
from wrenchbed.diagnosis.prepare.configured_simulator import STATED
from wrenchbed.diagnosis.prepare.prepared import Prepared
from wrenchbed.effects.base import Effect, Variant
from wrenchbed.effects.chain import effects

Candidate = tuple[Hypothesis, np.ndarray]
"""An explanation: a variant and its amplitudes (k,) in typical sizes."""

GAP = 0.3
"""Gap that the small imperfections of any robot are assumed to make."""
EFFECTS, ROWS = 0.5, 0.5
"""Shares of the background `GAP`: small effects of the library, and what no effect makes."""
FREE = 8.0
"""Prior standard deviation of a rival's amplitudes, in typical sizes."""
_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(41)
LEAST = 0.05
"""Divergence [nat] that an experiment must add to be worth proposing: of two explanations with
equal priors, the right one is then selected in 63 % of cases."""
SEPARATED = 0.1
"""Divergence [nat] that an experiment must add to two explanations to be said to separate them."""
MOST_PROPOSED = 4
"""Largest number of explanations that are compared, and of experiments that are proposed."""


_Column = tuple[Effect, str, Variant]
"""An effect, the name of one of its parameters, and a variant of it that frees this one."""


class Comparison:
    """Compares explanations in a recording and in experiments that may follow it.

    Args:
        d: dictionary of the recording.
        candidates: two or more explanations: a variant of an effect, and its fitted amplitudes.
        others: further recordings of the robot.
    """

    def __init__(
        self, d: EffectDictionary, candidates: Sequence[Candidate], others: Sequence[Prepared] = ()
    ) -> None:
        self.d, self.candidates = d, tuple(candidates)
        self.chosen, self._columns = _columns_of(d, self.candidates)
        self._place = {int(k): i for i, k in enumerate(self.chosen)}
        self.stated = np.array([self._place[int(k)] for k in d.stated], dtype=int)
        self.sizes = [np.zeros(len(self.chosen)) for _ in self.candidates]
        for x, (hypothesis, amplitudes) in zip(self.sizes, self.candidates, strict=True):
            x[self.columns_of(hypothesis)] = amplitudes
        self.background = self._background()
        noise = np.sqrt(row_variance(d.prepared, ROWS * GAP))[:, None]
        away = d.E[:, d.nuisance] / noise
        self._beside = sum(
            (self.information(ExperimentRun(o, again=False)) for o in others),
            start=np.zeros((len(self.chosen),) * 2),
        )
        information = _beyond(away, np.full(away.shape[1], LARGE), d.E[:, self.chosen] / noise)
        self.known = information + self._beside

    def columns_of(self, hypothesis: Hypothesis) -> np.ndarray:
        """Indices of a hypothesis' columns among all that this comparison uses."""
        return np.array([self._place[int(k)] for k in hypothesis.columns])

    def _background(self) -> np.ndarray:
        """Prior variance of each chosen column (n,) without any cause."""
        label = [self.d.label[k] for k in self.chosen]
        gap = self.d.configured_gap[self.chosen]
        named = sorted({e for e, _ in label if e not in STATED})
        result = np.zeros(len(label))
        for name in named:
            of = np.array([e == name for e, _ in label])
            share = EFFECTS * GAP / (len(named) * of.sum())
            result[of] = np.minimum(MOST**2, share / np.maximum(gap[of], 1e-12))
        result[self.stated] = LARGE
        blamed = {h.name for h, _ in self.candidates} & set(STATED)
        for k, place in enumerate(self.stated):
            if label[place][0] in blamed:  # its statement counts: it is what is in doubt
                result[place] = min(float(self.d.tolerance[k]) ** 2, LARGE)
        return result

    def columns(self, session: ExperimentRun) -> np.ndarray:
        """Change of an experiment's readings by each chosen column, over their noise (C R, n)."""
        base, at = session.prepared, _with_payload(session)
        mode = "dynamic" if base.moving else "static"
        response, v0 = Response(at.scene, at.channels), row_variance(base, ROWS * GAP)
        result = np.zeros((len(v0), len(self.chosen)))
        for k, (effect, parameter, variant) in enumerate(self._columns):
            if mode not in effect.modes:
                continue
            if session.payload is not None and effect.stated in ("mass", "cog"):
                half = 0.5 * float(self.d.size[self.chosen[k]])
                ends = (loaded(base, session.payload, **{parameter: s * half}) for s in (1, -1))
                up, down = (base.at(theta).expected for theta in ends)
                change = up - down
            else:
                known = {p.name: p for p in effect.parameters(at.robot)}
                change = response.tangent(effect, known[parameter], variant)
            result[:, k] = base.rows(change).ravel()
        return np.asarray(result / np.sqrt(v0)[:, None])

    def information(self, session: ExperimentRun) -> np.ndarray:
        """Information (n, n) on the columns' sizes from an experiment, and from the recording if it
        continues that. Numbers of the experiment alone, such as its zero, are unknown."""
        columns, at = self.columns(session), _with_payload(session)
        free, more = nuisance(session.prepared), list[np.ndarray]()
        if not session.again:
            zeros = np.eye(len(at.variance))  # of each measured column
            zeros = np.tile(zeros, (len(columns) // len(zeros), 1))
            free = np.concatenate([free, zeros], axis=1)
            more = self._only_there(at)
        wide = [np.full(free.shape[1], LARGE), *(np.ones(x.shape[1]) for x in more)]
        noise = np.sqrt(row_variance(at, ROWS * GAP))[:, None]
        return _beyond(np.concatenate([free, *more], axis=1) / noise, np.concatenate(wide), columns)

    def after(self, session: ExperimentRun) -> np.ndarray:
        """Information (n, n) on the columns' sizes from all recordings and the experiment."""
        known = self._beside if session.again else self.known
        return np.asarray(known + self.information(session))

    def _only_there(self, base: Prepared) -> list[np.ndarray]:
        """Columns, at typical size, of effects that only the planned mode (rest, motion) shows."""
        if base.moving == self.d.prepared.moving:
            return []
        mode, known = ("dynamic", "static") if base.moving else ("static", "dynamic")
        response, result = Response(base.scene, base.channels), []
        for effect in effects().values():
            variants = effect.variants(base.scene)
            if mode not in effect.modes or known in effect.modes or not variants:
                continue
            variant = max(variants, key=lambda v: len(v.free))
            names = {p.name: p for p in effect.parameters(base.robot)}
            changes = [response.tangent(effect, names[n], variant) for n in variant.free]
            result.append(np.stack([base.rows(c).ravel() for c in changes], axis=1))
        return result

    def distance(self, first: int, rival: int, known: np.ndarray) -> float:
        """Standard deviations between predictions of candidate ``first``, an index, and all that
        candidate ``rival`` can make, for an information ``known`` (n, n) on the columns' sizes."""
        variance = self.background.copy()
        variance[self.columns_of(self.candidates[rival][0])] += FREE**2
        x, root = self.sizes[first], np.sqrt(variance)
        along = known @ x
        inner = np.eye(len(x)) + root[:, None] * known * root
        taken = (root * along) @ np.linalg.solve(inner, root * along)
        return float(np.sqrt(max(x @ along - taken, 0.0)))

    def divergence(self, known: np.ndarray) -> dict[tuple[int, int], float]:
        """Jensen–Shannon divergence [nat], ≤ log 2, of each pair of candidates, by indices."""
        result = {}
        for a, b in combinations(range(len(self.candidates)), 2):
            both = (self.distance(a, b, known), self.distance(b, a, known))
            result[a, b] = 0.5 * sum(map(jensen_shannon, both))
        return result


def jensen_shannon(d: float) -> float:
    """Jensen–Shannon divergence [nat] of two Gaussians of equal width, d widths apart."""
    x = d / 2 + _NODES
    lost = np.logaddexp(0.0, -d * x) @ _WEIGHTS / _WEIGHTS.sum()
    return float(max(np.log(2.0) - lost, 0.0))


def settled(divergence: float) -> float:
    """Fraction of right decisions between two equally likely Gaussians of this divergence [nat]."""
    apart = np.linspace(0.0, 12.0, 241)
    known = [jensen_shannon(float(d)) for d in apart]
    return float(ndtr(np.interp(divergence, known, apart) / 2.0))


def _columns_of(
    d: EffectDictionary, candidates: Sequence[Candidate]
) -> tuple[np.ndarray, list[_Column]]:
    """Columns that a comparison needs, by index and in the same order: the candidates', the stated
    ones, one variant of each effect."""
    columns: dict[int, _Column] = {}

    def add(h: Hypothesis) -> None:
        for k, name in zip(h.columns, h.variant.free, strict=True):
            columns.setdefault(int(k), (h.effect, name, h.variant))

    for h, _ in candidates:
        add(h)
    for name in dict.fromkeys(h.name for h in d.hypotheses):
        of = [h for h in d.hypotheses if h.name == name]
        add(max(of, key=lambda h: len(h.columns)))
        if name in STATED:
            for h in of:
                add(h)
    for k in map(int, d.stated):  # also where nothing is stated, so that nothing can be wrong
        name, parameter = d.label[k]
        columns.setdefault(k, (effects()[name], parameter, Variant(name, (parameter,))))
    chosen = np.array(sorted(columns))
    return chosen, [columns[int(k)] for k in chosen]


def _beyond(own: np.ndarray, variance: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Information (n, n) of columns (C R, n) over white noise and other columns ``own`` (C R, m) of
    prior variances (m,)."""
    if not len(variance):
        return np.asarray(columns.T @ columns)
    return BackgroundLevel(own, np.ones(len(own)), variance).products(columns)


def _with_payload(session: ExperimentRun) -> Prepared:
    """Rows of an experiment, with its payload added to the tool."""
    base = session.prepared
    return base if session.payload is None else base.at(loaded(base, session.payload))


@dataclass(frozen=True, eq=False)
class Experiment:
    """A proposed experiment.

    Attributes:
        action: imperative sentence on what to do.
        separates: effects that it would separate, or the variable that it would show.
        gain: Jensen–Shannon divergence that it adds [nat/min], mean over pairs; 0 if it explores.
        minutes: duration, moves and mounting included [min].
        plan: plan to record; None where there is nothing to plan.
        sentence: whole proposal, for people.
    """

    action: str
    separates: tuple[str, ...]
    gain: float
    minutes: float
    plan: Plan | None
    sentence: str

    def entry(self, plan: str | None) -> dict[str, Any]:
        """Entry of ``next`` of diagnosis.json, with the file name of the plan."""
        stated = {f.name: getattr(self, f.name) for f in fields(self)}
        return stated | {"separates": list(self.separates), "plan": plan}


def candidates_of(analysis: Analysis, names: Collection[str]) -> tuple[Candidate, ...]:
    """Variant of each named effect in the best explanation that has it, and its amplitudes."""
    chosen: dict[str, Candidate] = {}
    refitter, d = analysis.refitter, analysis.dictionary
    shown = {effect for effect, parameter in d.label if parameter}
    for e in analysis.ranking.explanations:
        for part in e.parts:
            if part.name not in shown or part.name not in names or part.name in chosen:
                continue
            if part.index is None:
                variants = [h for h in d.hypotheses if h.name == part.name]
                h = max(variants, key=lambda h: len(h.columns))
                mean = stated(refitter, e.finalist).mean
                place = {int(k): i for i, k in enumerate(d.stated)}
                chosen[part.name] = (h, np.array([mean[place[int(k)]] for k in h.columns]))
                continue
            chosen[part.name] = candidate(e.finalist, part.index)
    return tuple(chosen.values())


def candidate(f: Finalist, part: int) -> Candidate:
    """Variant and fitted amplitudes (k,) of the cause of index ``part`` of a fitted set."""
    h, at = f.parts[part], f.variables.of_parts([part])
    size = {f.variables.name[i]: f.x[i] for i in at}
    return h, np.array([size[n] for n in h.variant.free])


def separate(
    d: EffectDictionary,
    candidates: Sequence[Candidate],
    seed: int = 0,
    others: Sequence[Prepared] = (),
) -> tuple[Experiment, ...]:
    """Propose experiments that separate ``candidates``; ``others``: further recordings so far."""
    candidates = [c for c in candidates if len(c[0].columns)]
    if len(candidates) < 2:
        return ()
    comparison = Comparison(d, candidates[:MOST_PROPOSED], others)
    before = comparison.divergence(comparison.known)
    several = {
        h.name for h, _ in comparison.candidates if h.name != comparison.candidates[0][0].name
    }
    names = [h.name if several else element(h.variant) for h, _ in comparison.candidates]
    labels = [f"{h.name} ({h.variant.label})" for h, _ in comparison.candidates]
    proposed = []
    for action in actions(d.prepared, seed, sweeps=1):
        after = comparison.divergence(comparison.after(action.session))
        added = {pair: after[pair] - before[pair] for pair in before}
        mean = float(np.mean(list(added.values())))
        pairs = [pair for pair, gain in added.items() if gain > SEPARATED]
        if mean < LEAST:
            continue
        best = max(added, key=lambda p: added[p])
        pairs = pairs or [best]
        apart = tuple(dict.fromkeys(names[k] for pair in pairs for k in pair))
        what = listed([f"{labels[a]} from {labels[b]}" for a, b in pairs], "and")
        some = sorted({labels[k] for pair in pairs for k in pair})
        if len(some) > 2 and 2 * len(pairs) == len(some) * (len(some) - 1):
            what = f"{listed(some, 'and')} from each other"
        now, then = before[best], after[best]
        shows = (
            f"it separates {what}; the probability of naming the right one rises from "
            f"{100 * settled(now):.0f} to {100 * settled(then):.0f} %"
        )
        proposed.append(_proposed(action, apart, mean / action.minutes, shows))
    return tuple(sorted(proposed, key=lambda e: -e.gain)[:MOST_PROPOSED])


def explore(prepared: Prepared, kernel: str, seed: int = 0) -> tuple[Experiment, ...]:
    """Propose experiments that show whether the residual depends on a variable (a kernel's name),
    the shortest first. Their gain is 0, since it is not defined for an unknown cause."""
    known = [action for action in actions(prepared, seed) if kernel in action.variables]
    shows = f"it shows whether the residual depends on {kernel}"
    some = sorted(known, key=lambda action: action.minutes)[:MOST_PROPOSED]
    return tuple(_proposed(action, (kernel,), 0.0, shows) for action in some)


def _proposed(action: Action, separates: tuple[str, ...], gain: float, shows: str) -> Experiment:
    sentence = f"{action.text[0].upper()}{action.text[1:]} ({action.minutes:.1f} min): {shows}."
    return Experiment(action.text, separates, gain, action.minutes, action.plan, sentence)
