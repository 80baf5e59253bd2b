"""What an accelerometer adds to a verdict: a tilt that it sees may be claimed though it is small.

A gap alone names a cause only when the cause is large against everything else that is not modelled.
A second sensor lifts that: whether there is a tilt is then settled without the wrench, which need
only agree, and be changed by it at all.
"""

from dataclasses import replace

import numpy as np
from scipy.special import chdtrc, logsumexp

from wrenchbed.diagnosis.evidence.search import NONE, UNKNOWN
from wrenchbed.diagnosis.explain.analysis import Analysis
from wrenchbed.diagnosis.explain.claims import Explanation, Part
from wrenchbed.diagnosis.explain.contributions import rest
from wrenchbed.diagnosis.explain.finalist import Finalist
from wrenchbed.diagnosis.explain.verdict import Cause, Verdict
from wrenchbed.diagnosis.prepare.accelerometer import TILT, Testimony

SURE = 0.9
"""Least probability of a tilt that is claimed although it alone would not count,"""
LEAST = 0.25
"""and least gap that it then adds: a quarter of what a cause needs without a second sensor."""
DISAGREE = 0.01
"""Below this p-value wrench and accelerometer contradict each other, and neither is believed."""


def with_accelerometer(a: Analysis, verdict: Verdict) -> Verdict:
    """The verdict with the tilt that the accelerometer sees, where wrench and it agree."""
    told = [e for e in a.ranking.explanations if TILT in e.finalist.names]
    if a.testimony is None or not told:
        return verdict
    own, present = verdict.explanation, _present(a)
    e = own if verdict.causes and TILT in own.finalist.names else told[0]
    if agreement(a, e, a.testimony) < DISAGREE:
        return verdict
    joint = replace(e, finalist=_joint(a, e.finalist, a.testimony))
    if any(TILT in c.names for c in verdict.causes):
        return replace(verdict, explanation=joint) if e is own else verdict
    part = _part(a, joint)
    if present < SURE or part.share < LEAST:
        return verdict
    cause = Cause((TILT,), present, part)
    if verdict.causes and verdict.verdict not in (NONE, UNKNOWN):
        both = (*verdict.causes, cause)
        return replace(verdict, causes=both, explanation=joint) if e is own else verdict
    rest = sum(verdict.probabilities.values())
    others = {k: v * (1.0 - present) / rest for k, v in verdict.probabilities.items() if k != TILT}
    others[UNKNOWN] = 1.0 - present - sum(v for k, v in others.items() if k != UNKNOWN)
    return Verdict("identified", (cause,), joint, {TILT: present} | others)


def sentences(a: Analysis, verdict: Verdict) -> tuple[str, ...]:
    """What the accelerometer says, and how it goes with the wrench."""
    t = a.testimony
    if t is None:
        return ()
    x, y = np.rad2deg(t.tilt)
    sx, sy = np.rad2deg(t.std)
    size = f"({x:.3f} ± {sx:.3f}, {y:.3f} ± {sy:.3f})° about x and y"
    if t.log_bayes < 0.0:
        return (f"the accelerometer sees no tilt of the base: {size}",)
    text = f"the accelerometer, without the wrench, sees the base tilted by {size}"
    told = [e for e in a.ranking.explanations if TILT in e.finalist.names]
    if not told:
        return (text,)
    wx, wy = np.rad2deg(_wrench(a, told[0])[0])
    p = agreement(a, told[0], t)
    agree = "agrees" if p >= DISAGREE else "does not agree"
    result = [f"{text}; the wrench's ({wx:.2f}, {wy:.2f})° {agree} (p = {p:.2g})"]
    if [c.names[0] for c in verdict.causes] == [TILT]:
        cause = verdict.causes[0].part
        left = rest(a.refitter, verdict.explanation.finalist, {cause.index})
    if [c.names[0] for c in verdict.causes] == [TILT] and left > cause.share:
        result.append(
            f"what is left, a gap of {left:.3g}, is not the tilt's, and no effect of the library "
            "explains it well enough to be named"
        )
    return tuple(result)


def agreement(a: Analysis, e: Explanation, t: Testimony) -> float:
    """p-value of the wrench's tilt and the accelerometer's being one."""
    value, covariance = _wrench(a, e)
    away = value - t.tilt
    return float(chdtrc(2, away @ np.linalg.solve(covariance + t.covariance, away)))


def _wrench(a: Analysis, e: Explanation) -> tuple[np.ndarray, np.ndarray]:
    """Tilt (2,) [rad] of an explanation and its covariance (2, 2)."""
    f, at = e.finalist, _places(a, e.finalist)
    size = _sizes(a, f)
    return f.x[at] * size, f.covariance[np.ix_(at, at)] * np.outer(size, size)


def _joint(a: Analysis, f: Finalist, t: Testimony) -> Finalist:
    """A finalist with its tilt as both sensors have it: one step of a Kalman filter."""
    at, size = _places(a, f), _sizes(a, f)
    inside = f.covariance[np.ix_(at, at)] + t.covariance / np.outer(size, size)
    weight = f.covariance[:, at] @ np.linalg.inv(inside)
    x = f.x + (weight @ (t.tilt / size - f.x[at]))[: len(f.x)]
    covariance = f.covariance - weight @ f.covariance[at]
    residual = a.refitter.y - a.refitter.response(f.parts, x)
    return replace(f, x=x, covariance=covariance, residual=residual)


def _places(a: Analysis, f: Finalist) -> list[int]:
    """Which of a finalist's variables are the tilt's."""
    own = f.names.index(TILT)
    return [i for i, (k, _, _) in enumerate(a.refitter.variables(f.parts)) if k == own]


def _sizes(a: Analysis, f: Finalist) -> np.ndarray:
    return np.asarray(a.dictionary.size[f.parts[f.names.index(TILT)].columns])


def _part(a: Analysis, e: Explanation) -> Part:
    """The tilt of an explanation with the gap that it makes alone."""
    f = e.finalist
    own = f.names.index(TILT)
    alone = a.refitter.response((f.parts[own],), f.x[_places(a, f)])
    return Part(TILT, a.dictionary.gap(alone), index=own)


def _present(a: Analysis) -> float:
    """Probability of a tilt among all explanations, known or not."""
    r = a.ranking
    logs = [(e.log_posterior, TILT in e.finalist.names) for e in r.explanations]
    total = logsumexp([r.unknown, *(v for v, _ in logs)])
    return float(np.exp(logsumexp([v for v, there in logs if there]) - total))
