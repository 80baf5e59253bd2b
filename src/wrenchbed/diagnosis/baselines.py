"""Simple ways to name a cause, which every benchmark of the diagnosis prints beside it.

All start from the same calibrated simulator and the same dictionary of effects as the diagnosis;
none has a background of small imperfections, a refit, or an answer for what no effect makes.
"""

from collections.abc import Callable, Mapping

import numpy as np
from scipy.special import logsumexp

from wrenchbed.diagnosis import regressions
from wrenchbed.diagnosis.dictionary import STATED
from wrenchbed.diagnosis.evidence import gains
from wrenchbed.diagnosis.linear import COUNTS, Claim, Linear, certain, known, linear, nothing
from wrenchbed.diagnosis.prepare import Prepared
from wrenchbed.diagnosis.search import NONE

__all__ = ["BASELINES", "Claim", "known"]


def none(prepared: Prepared) -> Claim:
    """Never a cause."""
    return nothing()


def largest_residual_channel(prepared: Prepared) -> Claim:
    """The effect whose signature spreads over the channels as the calibrated residual does.

    Where that fit leaves less than what counts, the stated number that it moved most.
    """
    problem = linear(prepared)
    d = problem.d
    if d.gap(problem.y) - problem.noise < COUNTS:
        return certain(_moved(problem)[:1])
    seen = np.sqrt(np.maximum((problem.residual**2).mean(axis=0) - d.prepared.variance, 0.0))
    left = d.E - d.fitted_away @ (d.fitted_away.T @ d.E)
    energy = (left.reshape(-1, 6, left.shape[1]) ** 2).sum(axis=0)
    best, likeness = "", -1.0
    for h in d.hypotheses:
        pattern = np.sqrt(energy[:, h.columns].sum(axis=1))
        cosine = float(seen @ pattern) / max(float(np.linalg.norm(pattern)), 1e-12)
        if h.name not in STATED and cosine > likeness:
            best, likeness = h.name, cosine
    return certain([best])


def bic(prepared: Prepared) -> Claim:
    """The single effect, or none, of least BIC; probabilities from exp(−ΔBIC/2)."""
    return _leading(_bic(linear(prepared)))


def bic_counting(prepared: Prepared) -> Claim:
    """The same, where an effect that adds less than what counts is no cause."""
    problem = linear(prepared)
    counts = dict.fromkeys((h.name for h in problem.d.hypotheses), False)
    best: dict[str, float] = {}
    n = len(problem.y)
    for s in problem.singles:
        name, value = s.hypothesis.name, s.gain - s.freedom * np.log(n)
        if value > best.get(name, -np.inf):
            best[name] = value
            counts[name] = problem.added(name, s.hypothesis.columns, s.x) >= COUNTS
    logs = _bic(problem)
    small = [k for k, v in counts.items() if not v]
    told = {k: v for k, v in logs.items() if k not in small}
    told[NONE] = float(logsumexp([logs[NONE], *(logs[k] for k in small)]))
    return _leading(told)


def bayes(prepared: Prepared) -> Claim:
    """The largest Bayes factor of a single effect at its typical size, all alike beforehand."""
    problem = linear(prepared)
    P, w = problem.problem
    logs: dict[str, list[float]] = {}
    for h in problem.d.hypotheses:
        own = h.columns
        gain = gains(P[None][:, own[:, None], own], w[None, own, None],
                     np.ones((1, len(own))), np.ones(1))  # fmt: skip
        logs.setdefault(h.name, []).append(float(gain[0, 0, 0]))
    mean = {k: float(logsumexp(v) - np.log(len(v))) for k, v in logs.items()}
    return _leading({NONE: 0.0} | mean)


def lasso(prepared: Prepared) -> Claim:
    """LASSO over all columns with a cross-validated penalty."""
    return regressions.lasso(linear(prepared))


def everything(prepared: Prepared) -> Claim:
    """All effects free in one ridge fit."""
    return regressions.everything(linear(prepared))


def _bic(problem: Linear) -> dict[str, float]:
    """−½ BIC against none, of the best variant of each effect."""
    n = len(problem.y)
    logs = {NONE: 0.0}
    for s in problem.singles:
        value = 0.5 * (s.gain - s.freedom * float(np.log(n)))
        logs[s.hypothesis.name] = max(value, logs.get(s.hypothesis.name, -np.inf))
    return logs


def _leading(logs: Mapping[str, float]) -> Claim:
    total = logsumexp(list(logs.values()))
    told = {k: float(np.exp(v - total)) for k, v in logs.items()}
    best = max(told, key=lambda k: told[k])
    if best == NONE:
        return Claim(NONE, (), told)
    return Claim("identified", ((best,),), told)


def _moved(problem: Linear) -> list[str]:
    """Stated numbers that the calibration moved beyond tolerance and that count, largest first."""
    d = problem.d
    found = np.linalg.lstsq(d.E[:, d.stated], problem.y, rcond=1e-10)[0]
    gaps = {}
    for name in STATED:
        own = np.array([d.label[k][0] == name for k in d.stated])
        if (np.abs(found[own]) > d.tolerance[own]).any():
            gaps[name] = problem.added(name, d.stated[own], found[own])
    return sorted((n for n, g in gaps.items() if g >= COUNTS), key=lambda n: -gaps[n])


BASELINES: dict[str, Callable[[Prepared], Claim]] = {
    "none": none,
    "largest-residual-channel": largest_residual_channel,
    "bic": bic,
    "bic-counting": bic_counting,
    "bayes": bayes,
    "lasso": lasso,
    "everything": everything,
}
