"""How often claims like this one are right, learnt from look-alike cases of another generator.

Evidence is exact only for the physics that it knows. A logistic model of what distinguishes claims
that were right from wrong ones, in look-alike cases, turns it into probabilities that hold; the
verdict follows from these (Guo et al. 2017, arXiv 1706.04599, calibrate classifiers likewise).
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import resources
from typing import Any

import numpy as np
from scipy.special import expit, logit

from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.explain.claims import Explanation, allowed
from wrenchbed.diagnosis.explain.structures import Ranking
from wrenchbed.diagnosis.explain.verdict import Verdict
from wrenchbed.errors import DiagnosisError

NAMES = (
    "constant", "size", "rest", "lead", "unknown", "more", "form", "rivals", "minor", "open",
)  # fmt: skip
"""Names of a claim's features, each about 0 … 1."""
PRIOR_STD = 3.0
"""Prior standard deviation of a weight, so that few cases do not make a certain model."""
LEAST_ERRORS, LARGEST_SPREAD = 40, 2.5
"""Fewest errors from which a spread is learnt, four of them beyond the 90 % quantile, and the
largest factor by which it widens uncertainties: a larger one would hide that a model is wrong."""
RIGHT_ELSEWHERE = 0.85
"""Largest share of right claims that is believed of robots that nothing was learnt on: 23 of 27 new
names were right in faults added to a real recording (docs/explanation/benchmark.md)."""
LEVEL = 0.9
"""Probability that a set of causes holds where nothing was learnt."""
ROUNDING = 1e-9
"""Rounding error by which a sum of probabilities may fall short of 1."""


@dataclass(frozen=True)
class Reliability:
    """A logistic model of being right.

    Attributes:
        claim: weight of each feature of a named cause, in the order of `NAMES`.
        none, unknown: share of such answers that were right.
        cases: that it was learnt from.
        source: where these are from.
        spread: factor on standard uncertainties with which 90 % intervals held 90 % of the time.
        right: share of all claims that were right.
        set90: probability that the likeliest answers must hold together to hold the truth in 90 %
            of cases: split conformal prediction (Vovk et al. 2005; Angelopoulos & Bates 2023,
            doi 10.1561/2200000101).
        elsewhere: whether those of the package are of other robots or designs than the recording.
        own: whether they are look-alikes of the recording itself.
    """

    claim: tuple[float, ...]
    none: float
    unknown: float
    cases: int
    source: str
    spread: float = 1.0
    right: float = 0.9
    set90: float = 0.9
    elsewhere: bool = False
    own: bool = False

    def plain(self) -> "Reliability":
        """Model for recordings unlike the learnt cases: one fraction of right claims of any
        kind."""
        right = min(self.right, RIGHT_ELSEWHERE)
        claim = (float(logit(right)), *(0.0,) * (len(NAMES) - 1))
        return replace(self, claim=claim, right=right, elsewhere=True)

    def of(self, features: Sequence[float]) -> float:
        """Probability that a claim with such features is right."""
        return float(expit(np.dot(self.claim, features)))


def features(ranking: Ranking, verdict: Verdict[Explanation], closed: float) -> tuple[float, ...]:
    """Features of a verdict's leading claim; all zero if no cause is named.

    Args:
        ranking: all explanations.
        verdict: that held-out rows uphold.
        closed: share of the gap that its causes close on these.
    """
    if not verdict.causes:
        return (0.0,) * len(NAMES)
    best, lead = verdict.explanation, verdict.causes[0]
    others = [e.log_posterior for e in ranking.explanations if not e.names & set(lead.names)]
    beaten = best.log_posterior - max(others, default=best.log_posterior - 30.0)
    known = best.log_posterior - max(ranking.unknown, ranking.mixed)
    form = 0.0
    if lead.part.index is not None:
        form = best.finalist.parts[lead.part.index].effect.form_error
    minor = len(best.finalist.parts) - len(best.parts)
    return (
        1.0,
        float(np.log10(np.clip(lead.part.share, 0.5, 1e3)) / 3.0),
        float(np.clip(best.rest / allowed(best), 0.0, 2.0)),
        float(np.log1p(np.clip(beaten, 0.0, 1e3)) / 7.0),
        float(np.log1p(np.clip(known, 0.0, 1e3)) / 7.0),
        (len(verdict.causes) - 1) / 2.0,
        2.0 * form,
        (len(lead.names) - 1) / 4.0,
        float(np.clip(minor, 0, 4)) / 4.0,
        float(np.clip(1.0 - closed, 0.0, 1.0)),
    )


def conformal(shares: Sequence[float], level: float = 0.9) -> float:
    """Probability that a set must hold to hold the truth as often as ``level``.

    Args:
        shares: of each case, what the answers down to the true one hold together (N,).
    """
    rank = int(np.ceil((len(shares) + 1) * level))
    return float(np.sort(shares)[min(rank, len(shares)) - 1]) if len(shares) else level


def credible(probabilities: Mapping[str, float], level: float) -> tuple[str, ...]:
    """The likeliest answers that hold a probability together, classes by their members."""
    total, names = 0.0, dict[str, None]()
    for key, share in sorted(probabilities.items(), key=lambda kv: -kv[1]):
        names |= dict.fromkeys(key.split("|"))
        total += share
        if total >= level - ROUNDING:
            break
    return tuple(names)


def set90(verdict: Verdict[Any], known: Reliability | None) -> tuple[str, ...]:
    """Names that hold the truth in 90 % of such cases: the likeliest answers, and all claims."""
    names = credible(verdict.probabilities, LEVEL if known is None else known.set90)
    return tuple(dict.fromkeys((*names, *(n for c in verdict.causes for n in c.names))))


def learnt(
    claims: Sequence[tuple[Sequence[float], bool]],
    none: tuple[int, int],
    unknown: tuple[int, int],
    source: str,
    start: "Reliability | None" = None,
    errors: Sequence[float] = (),
    shares: Sequence[float] = (),
) -> Reliability:
    """The most probable model for (features, was it right) of cases; none and unknown: (right, of).

    Args:
        start: what is believed before these cases; its weights are the prior's centre.
        errors: of parameters over their standard uncertainty; few teach no spread.
        shares: of each case, what its answers down to the true one hold together.

    Raises:
        DiagnosisError: no claims to learn from.
    """
    from scipy.optimize import minimize  # slow to load: only when it is used

    if not claims:
        raise DiagnosisError("no case names a cause: nothing to learn reliability from")
    x = np.array([f for f, _ in claims], dtype=float)
    y = np.array([right for _, right in claims], dtype=float)
    centre = np.zeros(len(NAMES)) if start is None else np.array(start.claim)
    if start is None:
        centre[0] = 2.0
    sign = 2.0 * y - 1.0

    def cost(w: np.ndarray) -> float:
        loss = np.logaddexp(0.0, -sign * (x @ w)).sum()
        return float(loss + 0.5 * ((w - centre) ** 2).sum() / PRIOR_STD**2)

    w = minimize(cost, centre, method="BFGS").x
    count = len(claims) + none[1] + unknown[1]
    spread = 1.0 if start is None else start.spread
    if len(errors) >= LEAST_ERRORS:
        spread = float(np.clip(np.quantile(np.abs(errors), 0.9) / 1.645, 1.0, LARGEST_SPREAD))
    held = 0.9 if start is None else start.set90
    if len(shares) >= LEAST_ERRORS:
        held = conformal(shares)
    result = Reliability(
        tuple(float(v) for v in w), _rate(*none), _rate(*unknown), count, source, spread,
        _rate(int(y.sum()), len(y)), held,
    )  # fmt: skip
    return result if start is None else _pooled(start, result)


def _pooled(before: Reliability, now: Reliability) -> Reliability:
    """Rates of both, by their numbers of cases; weights of the later one, which knows the other."""
    total = before.cases + now.cases
    share = now.cases / total
    rates = {
        name: (1.0 - share) * getattr(before, name) + share * getattr(now, name)
        for name in ("none", "unknown", "spread", "right")
    }
    return replace(now, cases=total, **rates)


def _rate(right: int, count: int) -> float:
    return (right + 1.0) / (count + 2.0)


@lru_cache(maxsize=1)
def _shipped() -> Mapping[str, Any]:
    folder = resources.files("wrenchbed.diagnosis.explain")
    return dict(json.loads(folder.joinpath("reliability.json").read_text("utf-8")))


def shipped(robot: str, moving: bool, usual: bool = True) -> Reliability | None:
    """The model that comes with the package, of the robot at rest or in motion.

    A robot without one, or a recording without joint values or wrench, has that of all robots
    together, whatever the kind of a claim.
    """
    mode = "dynamic" if moving else "static"
    known, name = _shipped(), f"{robot} {mode}"
    raw = known.get(name) or known.get(mode)
    if raw is None:
        return None
    result = Reliability(**raw | {"claim": tuple(raw["claim"])})
    return result if name in known and usual else result.plain()


def of_package(recording: Recording) -> Reliability | None:
    """Reliability model of the package for such a recording, marked ``elsewhere`` if learnt on
    other robots or designs."""
    metadata = recording.metadata
    usual = bool(recording.joints) and recording.has_wrench
    return shipped(metadata.robot, metadata.mode == "dynamic", usual)


def revision() -> str:
    """Hash of what comes with the package: learnt again whenever claims change."""
    return hashlib.sha256(json.dumps(dict(_shipped()), sort_keys=True).encode()).hexdigest()[:16]
