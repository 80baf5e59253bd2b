"""How often answers are right, learnt from simulated cases (look-alikes) of many arms and designs.

Evidence is exact only for the physics that it knows. A monotone logistic map from what evidence and
held-out rows say for a claim gives the share of such claims that were right in cases of another
generator (Guo et al. 2017, arXiv 1706.04599, calibrate classifiers likewise). The cases ship as
`Lesson`s, of 6- and 7-joint arms; look-alikes of a recording itself are further lessons.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import resources
from typing import Any

import numpy as np
from scipy.special import betainc, expit

from wrenchbed.diagnosis.evidence.search import NONE, UNKNOWN
from wrenchbed.diagnosis.explain import familiarity
from wrenchbed.diagnosis.explain.claims import REST
from wrenchbed.diagnosis.explain.verdict import Verdict
from wrenchbed.errors import DiagnosisError

NAMES = ("constant", "evidence", "closed", "complete", "still")
"""Features of a claim, each 0 … 1: a constant 1, scaled log odds of the evidence, least share of
the gap that it closes on held-out rows, 1 less the gap left there over `REST`, and whether the
robot was at rest. Seven others had no better log score (six arms, each judged by the others)."""
MOST_ODDS = 30.0
"""Log odds beyond which evidence is as sure as it can be: less likely structures are dropped."""
PRIOR_STD = 3.0
"""Prior standard deviation of a weight, so that few cases do not make a certain model."""
STEPS = 50
"""Steps of Newton's method; the cost is convex, and ten are enough for all digits."""
LEAST_ERRORS, LARGEST_SPREAD = 40, 2.5
"""Fewest errors from which a spread is learnt, four of them beyond the 90 % quantile, and the
largest factor by which it widens uncertainties: a larger one would hide that a model is wrong."""
RIGHT_ELSEWHERE = 0.85
"""Largest probability of a claim on recordings unlike the learning cases: 23 of 27 new names were
right in faults added to a real recording (docs/explanation/benchmark.md)."""
SPREAD_ELSEWHERE = 2.0
"""Factor on standard uncertainties of recordings unlike the learning cases: look-alikes of UR5 and
MedRUE gave, at commit 9a263b67, 1.8 to 2.0 at rest and 2.1 in motion."""
COVERED, CONFIDENT = 0.9, 0.95
"""Share of cases whose truth a set of names must contain, and the confidence of that share."""
ROUNDING = 1e-9
"""Rounding error by which a sum of probabilities may fall short of 1."""


@dataclass(frozen=True)
class Lesson:
    """Answer to one learning case, and its truth.

    Attributes:
        arm, mode: robot and mode (``static`` or ``dynamic``) of the recording.
        case: name of the simulated recording: its seed and number.
        features: features of its leading claim, in the order of `NAMES`; empty without a claim.
        lead: key, among the probabilities, of the answer by evidence (probability of the readings)
            and rows that no fit used, before anything is learnt.
        truth: keys of the right answers.
        probabilities: probabilities of the answers, by evidence.
        errors: errors of parameters of true causes over their standard uncertainties.
        design: features of the recording, in the order of `familiarity.NAMES`.
        weight: number of cases that it stands for.
    """

    arm: str
    mode: str
    case: str
    features: tuple[float, ...]
    lead: str
    truth: tuple[str, ...]
    probabilities: Mapping[str, float]
    errors: tuple[float, ...]
    design: tuple[float, ...]
    weight: float = 1.0

    @property
    def right(self) -> bool:
        """Whether the leading answer is right."""
        return self.lead in self.truth


@dataclass(frozen=True)
class Reliability:
    """Learnt model of the share of answers that are right.

    Attributes:
        claim: weight of each feature of a named cause, in the order of `NAMES`.
        none, unknown: share of answers ``none`` and ``unknown`` that were right.
        source: description of the learning cases.
        spread: factor on standard uncertainties with which 90 % intervals held 90 % of the time.
        set90: probability that the likeliest answers must sum to, so that they contain the truth.
        believed: upper limit of the probability of a claim.
        designs: features of the learning cases' recordings (N, F), by mode.
    """

    claim: tuple[float, ...]
    none: float
    unknown: float
    source: str
    spread: float = 1.0
    set90: float = COVERED
    believed: float = 1.0
    designs: Mapping[str, np.ndarray] = field(default_factory=dict)

    def right(self, verdict: Verdict[Any], closed: float, left: float, mode: str) -> float:
        """Share of answers like a verdict that are right, 0 … 1; arguments as of `features`."""
        if not verdict.causes:
            return self.none if verdict.word == NONE else self.unknown
        return self.of(features(verdict, closed, left, mode))

    def of(self, features: Sequence[float]) -> float:
        """Probability that a claim with these `features` is right."""
        return min(float(expit(np.dot(self.claim, features))), self.believed)

    def p_value(self, mode: str, design: Sequence[float]) -> float:
        """Conformal p-value that a recording is like the learning cases of a ``mode`` (``static``,
        ``dynamic``); ``design``: its features in the order of `familiarity.NAMES`."""
        taught = self.designs.get(mode)
        return 1.0 if taught is None else familiarity.p_value(design, taught)

    def unlike(self, p_value: float, mode: str) -> bool:
        """Whether a p-value is of a recording unlike the learning cases of a mode, ``static`` or
        ``dynamic``: less typical than 99 % of them or, where these are fewer than 100, than all.
        A model that learnt from nothing (`UNLEARNT`) calls none unlike."""
        count = len(self.designs.get(mode, ()))
        few = bool(self.designs) and p_value * max(count, 1) <= 1.0
        return few or p_value < familiarity.LEAST_P

    def believed_at(self, p_value: float, mode: str) -> "Reliability":
        """Model for a recording with a p-value: less sure if it is unlike the cases of its mode."""
        if not self.unlike(p_value, mode):
            return self
        believed, spread = min(self.believed, RIGHT_ELSEWHERE), max(self.spread, SPREAD_ELSEWHERE)
        return replace(self, believed=believed, spread=spread)


UNLEARNT = Reliability((MOST_ODDS, 0.0, 0.0, 0.0, 0.0), 1.0, 1.0, "nothing")
"""Model that believes the evidence as it is; `Lesson`s are made with it."""


def features(verdict: Verdict[Any], closed: float, left: float, mode: str) -> tuple[float, ...]:
    """Features (F,), in the order of `NAMES`, of a verdict's leading claim. ``closed``: least share
    of the gap that its causes close on held-out rows; ``left``: gap beyond noise that they leave
    there; ``mode``: ``static`` or ``dynamic``."""
    lead = key_of(verdict)
    others = sum(p for name, p in verdict.probabilities.items() if name != lead)
    odds = np.log(max(verdict.probabilities[lead], 1e-300) / max(others, 1e-300))
    return (
        1.0,
        float(np.log1p(np.clip(odds, 0.0, MOST_ODDS)) / np.log1p(MOST_ODDS)),
        float(np.clip(closed, 0.0, 1.0)),
        float(np.clip(1.0 - left / REST, 0.0, 1.0)),
        float(mode == "static"),
    )


def key_of(verdict: Verdict[Any]) -> str:
    """Key of a verdict's answer among its probabilities."""
    return "|".join(verdict.causes[0].names) if verdict.causes else verdict.word


def tempered(probabilities: Mapping[str, float], lead: str, right: float) -> dict[str, float]:
    """Probabilities after the leading answer's was multiplied by the share ``right``.

    What it loses goes to ``unknown``; what ``unknown`` loses goes to all others alike.
    """
    result = dict(probabilities)
    spare = result[lead] * (1.0 - right)
    result[lead] -= spare
    others = [UNKNOWN] if lead != UNKNOWN else [n for n in result if n != UNKNOWN] or [NONE]
    for name in others:
        result[name] = result.get(name, 0.0) + spare / len(others)
    return result


def conformal(shares: Sequence[float], weights: Sequence[float]) -> float:
    """Probability that the likeliest answers must sum to, so that they contain the truth in
    `COVERED` of cases, with confidence `CONFIDENT` over the sampled cases.

    The share that the k-th of n shares covers is Beta(k, n + 1 − k) (Vovk 2012, arXiv 1209.2673;
    arXiv 2509.15349 for few cases). Weighted cases count for (Σw)²/Σw² of them. ``shares`` (N,):
    probability of each case's likeliest answers down to the true one.
    """
    w = np.asarray(weights, dtype=float)
    count = int(w.sum() ** 2 / (w**2).sum()) if len(w) else 0
    k = np.arange(1, count + 1)
    enough = k[betainc(k, count + 1 - k, COVERED) <= 1.0 - CONFIDENT]
    if not len(enough):
        return 1.0
    order = np.argsort(shares)
    below = np.cumsum(w[order]) / w.sum()
    at = np.searchsorted(below, enough[0] / count - ROUNDING)
    return float(np.asarray(shares)[order][min(at, len(w) - 1)])


def credible(probabilities: Mapping[str, float], level: float) -> tuple[str, ...]:
    """Names of the likeliest answers that sum to ``level``; for a class, names of its members."""
    total, names = 0.0, dict[str, None]()
    for name, share in sorted(probabilities.items(), key=lambda kv: -kv[1]):
        names |= dict.fromkeys(name.split("|"))
        total += share
        if total >= level - ROUNDING:
            break
    return tuple(names)


def set90(verdict: Verdict[Any], known: Reliability) -> tuple[str, ...]:
    """Names that hold the truth in 90 % of cases like this one: the likeliest, and all claims."""
    names = credible(verdict.probabilities, known.set90)
    return tuple(dict.fromkeys((*names, *(n for c in verdict.causes for n in c.names))))


def learnt(lessons: Sequence[Lesson], source: str) -> Reliability:
    """Fit the model to lessons, which ``source`` describes in words.

    Raises:
        DiagnosisError: no lesson has a claim.
    """
    claims = [x for x in lessons if x.features]
    if not claims:
        raise DiagnosisError("no case names a cause: nothing to learn reliability from")
    modes = {x.mode for x in lessons}
    errors = [abs(e) for x in lessons for e in x.errors]
    spread = 1.0
    if len(errors) >= LEAST_ERRORS:
        spread = float(np.clip(np.quantile(errors, 0.9) / 1.645, 1.0, LARGEST_SPREAD))
    of_kind = {word: [x for x in lessons if x.lead == word] for word in (NONE, UNKNOWN)}
    none, unknown = (_rate(some) for some in of_kind.values())
    model = Reliability(
        _weights(claims), none, unknown, source, spread,
        designs={m: np.array([x.design for x in lessons if x.mode == m]) for m in modes},
    )  # fmt: skip
    shares = [_held(model, x) for x in lessons]
    return replace(model, set90=conformal(shares, [x.weight for x in lessons]))


def _weights(claims: Sequence[Lesson]) -> tuple[float, ...]:
    """Most probable weights (F,) of the features, ≥ 0 but for the constant's.

    Newton's method on the weights that are not held at 0.
    """
    x, weight = (np.array([getattr(c, n) for c in claims]) for n in ("features", "weight"))
    right = np.array([c.right for c in claims], dtype=float)
    w, least = np.zeros(len(NAMES)), np.array([-np.inf, *[0.0] * (len(NAMES) - 1)])
    for _ in range(STEPS):
        p = expit(x @ w)
        slope = w / PRIOR_STD**2 - (weight * (right - p)) @ x
        curve = (x.T * (weight * p * (1.0 - p))) @ x + np.eye(len(w)) / PRIOR_STD**2
        free = np.flatnonzero((w > least) | (slope < 0.0))
        w[free] -= np.linalg.solve(curve[np.ix_(free, free)], slope[free])
        w = np.maximum(w, least)
    return tuple(float(v) for v in w)


def _rate(lessons: Sequence[Lesson]) -> float:
    """Share of lessons that were right, with one right and one wrong added (Laplace)."""
    right = sum(x.weight for x in lessons if x.right)
    return (right + 1.0) / (sum(x.weight for x in lessons) + 2.0)


def _held(model: Reliability, x: Lesson) -> float:
    """Probability of a lesson's likeliest answers down to a true one; 1 if none is true."""
    right = model.of(x.features) if x.features else getattr(model, x.lead)
    total = 0.0
    after = tempered(x.probabilities, x.lead, right)
    for name, share in sorted(after.items(), key=lambda kv: -kv[1]):
        total += share
        if name in x.truth:
            return total
    return 1.0


@cache
def lessons() -> tuple[Lesson, ...]:
    """Answers to learning cases, with their truth, from which probabilities are learnt."""
    file = resources.files("wrenchbed.diagnosis.explain").joinpath("lessons.jsonl")
    return tuple(of_json(json.loads(line)) for line in file.read_text("utf-8").splitlines())


def of_json(raw: Mapping[str, Any]) -> Lesson:
    """Lesson from the JSON object that ``dataclasses.asdict`` made of it."""
    lists = ("features", "truth", "errors", "design")
    fields: dict[str, Any] = {k: tuple(v) if k in lists else v for k, v in raw.items()}
    return Lesson(**fields)


@cache
def shipped() -> Reliability:
    """Model learnt from the lessons that ship with the package."""
    arms = len({x.arm for x in lessons()})
    return learnt(lessons(), f"{len(lessons())} simulated cases of {arms} arms")
