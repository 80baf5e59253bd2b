"""What an accelerometer adds to a verdict: a tilt that it measures may be claimed though small.

A gap alone names a cause only when the cause is large against everything else that is not modelled.
A second sensor removes that limit: it decides whether there is a tilt, and the wrench need only
agree with it and be changed by it at all.
"""

from dataclasses import replace

import numpy as np
from scipy.special import chdtrc, logsumexp

from wrenchbed.diagnosis.evidence.search import NONE, UNKNOWN
from wrenchbed.diagnosis.explain.claims import Explanation
from wrenchbed.diagnosis.explain.contributions import rest
from wrenchbed.diagnosis.explain.finalist import Finalist
from wrenchbed.diagnosis.explain.structures import Analysis
from wrenchbed.diagnosis.explain.verdict import Cause, Part, Verdict
from wrenchbed.diagnosis.prepare.accelerometer import TILT, Testimony

SURE = 0.9
"""Least probability of a tilt that is claimed although its gap alone would not count: below, one
claim of ten or more would be wrong; near 1 a second sensor would hardly ever decide,"""
LEAST = 0.25
"""and least gap that it then adds: a quarter of what a cause needs without a second sensor."""
DISAGREE = 0.01
"""P-value below which wrench and accelerometer contradict each other; neither is then used."""


def with_accelerometer(a: Analysis, verdict: Verdict[Explanation]) -> Verdict[Explanation]:
    """The verdict with the tilt that the accelerometer sees, where wrench and it agree."""
    t, tilted, claimed = a.prepared.testimony, _tilted(a), verdict.explanation
    if t is None or not tilted:
        return verdict
    e = claimed if verdict.causes and TILT in claimed.finalist.names else tilted[0]
    if agreement(a, e, t) < DISAGREE:
        return verdict
    joint, present = replace(e, finalist=_joint(a, e.finalist, t)), _present(a)
    if any(TILT in c.names for c in verdict.causes):
        return replace(verdict, explanation=joint) if e is claimed else verdict
    part = _part(a, joint)
    if present < SURE or part.share < LEAST:
        return verdict
    cause = Cause(((TILT, None),), present, part)
    if verdict.causes and verdict.word not in (NONE, UNKNOWN):
        both = (*verdict.causes, cause)
        return replace(verdict, causes=both, explanation=joint) if e is claimed else verdict
    total = sum(verdict.probabilities.values())
    others = {k: v * (1.0 - present) / total for k, v in verdict.probabilities.items() if k != TILT}
    others[UNKNOWN] = 1.0 - present - sum(v for k, v in others.items() if k != UNKNOWN)
    return Verdict("identified", (cause,), joint, {TILT: present} | others)


def witnessed(a: Analysis, verdict: Verdict[Explanation]) -> tuple[str, ...]:
    """Claimed effects that the accelerometer measured too: the tilt, where it and wrench agree."""
    t, e = a.prepared.testimony, verdict.explanation
    if t is None or t.log_bayes <= 0.0 or TILT not in e.finalist.names:
        return ()
    return (TILT,) if agreement(a, e, t) >= DISAGREE else ()


def sentences(a: Analysis, verdict: Verdict[Explanation]) -> tuple[str, ...]:
    """Sentences on the tilt that the accelerometer measures, and its agreement with the wrench."""
    t = a.prepared.testimony
    if t is None:
        return ()
    x, y = np.rad2deg(t.tilt).round(3) + 0.0  # no minus zero
    sx, sy = np.rad2deg(t.std)
    size = f"({x:.3f} ± {sx:.3f}, {y:.3f} ± {sy:.3f})° about x and y"
    if t.log_bayes < 0.0:
        return (f"the accelerometer measures no tilt of the base: {size}",)
    text = f"the accelerometer alone measures a tilt of the base of {size}"
    tilted = _tilted(a)
    if not tilted:
        return (text,)
    wx, wy = np.rad2deg(_wrench(a, tilted[0])[0]).round(2) + 0.0  # no minus zero
    p = agreement(a, tilted[0], t)
    agree = "agrees" if p >= DISAGREE else "does not agree"
    result = [f"{text}; the wrench gives ({wx:.2f}, {wy:.2f})° and {agree} (p = {p:.2g})"]
    if [c.names[0] for c in verdict.causes] == [TILT]:
        cause = verdict.causes[0].part
        remaining = rest(a.refitter, verdict.explanation.finalist, {cause.index})
        if remaining > cause.share:
            result.append(
                f"the tilt does not explain the remaining gap of {remaining:.3g}, and no effect of "
                "the library explains it well enough to be named"
            )
    return tuple(result)


def _tilted(a: Analysis) -> list[Explanation]:
    """Explanations that include a base tilt, best first."""
    return [e for e in a.ranking.explanations if TILT in e.finalist.names]


def agreement(a: Analysis, e: Explanation, t: Testimony) -> float:
    """p-value of the wrench's tilt and the accelerometer's being one."""
    value, covariance = _wrench(a, e)
    away = value - t.tilt
    return float(chdtrc(2, away @ np.linalg.solve(covariance + t.covariance, away)))


def _wrench(a: Analysis, e: Explanation) -> tuple[np.ndarray, np.ndarray]:
    """Tilt (2,) [rad] of an explanation and its covariance (2, 2)."""
    f, at = e.finalist, _places(e.finalist)
    size = _sizes(a, f)
    return f.x[at] * size, f.covariance[np.ix_(at, at)] * np.outer(size, size)


def _joint(a: Analysis, f: Finalist, t: Testimony) -> Finalist:
    """A finalist with its tilt as both sensors have it: one step of a Kalman filter."""
    at, size = _places(f), _sizes(a, f)
    inside = f.covariance[np.ix_(at, at)] + t.covariance / np.outer(size, size)
    weight = f.covariance[:, at] @ np.linalg.inv(inside)
    x = f.x + (weight @ (t.tilt / size - f.x[at]))[: len(f.x)]
    covariance = f.covariance - weight @ f.covariance[at]
    residual = a.refitter.y - a.refitter.response(f.parts, x)
    return replace(f, x=x, covariance=covariance, residual=residual)


def _places(f: Finalist) -> np.ndarray:
    """Indices of a finalist's variables that belong to the tilt."""
    return f.variables.of_parts([f.names.index(TILT)])


def _sizes(a: Analysis, f: Finalist) -> np.ndarray:
    return np.asarray(a.dictionary.size[f.parts[f.names.index(TILT)].columns])


def _part(a: Analysis, e: Explanation) -> Part:
    """The tilt of an explanation with the gap that it makes alone."""
    f = e.finalist
    number = f.names.index(TILT)
    alone = a.refitter.response((f.parts[number],), f.x[_places(f)])
    return Part(TILT, a.dictionary.gap(alone), index=number)


def _present(a: Analysis) -> float:
    """Probability of a tilt among all explanations, known or not."""
    r = a.ranking
    logs = [(e.log_posterior, TILT in e.finalist.names) for e in r.explanations]
    total = logsumexp([r.unknown, *(v for v, _ in logs)])
    return float(np.exp(logsumexp([v for v, there in logs if there]) - total))
