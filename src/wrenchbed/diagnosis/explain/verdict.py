"""What may be claimed: none, unknown, or causes, each a class with its rivals and probability."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import logsumexp

from wrenchbed.diagnosis.evidence.search import NONE, UNKNOWN
from wrenchbed.diagnosis.explain.claims import REST, Explanation, Part
from wrenchbed.diagnosis.explain.contributions import CLAIMABLE
from wrenchbed.diagnosis.explain.elements import DOUBT, RIVAL, Elements
from wrenchbed.diagnosis.explain.structures import MARGIN, Ranking

MOST_RIVALS = 4
"""Most rivals of a named cause: a reader who gets more than five candidates learns nothing, so the
verdict is unknown; with fewer, pairs of look-alike effects and their mixtures would be unknown."""
CONTRIVED = 0.05
"""Least weight, beside 1, of an effect that makes a cause's readings with numbers that happen to
fit: evidence against it is as good as what is taken for its likely sizes. Estimate."""
INSEPARABLE = tuple(frozenset({"mount.rotation", n}) for n in ("joint.offset", "sensor.crosstalk"))
"""Pairs of effects that no data without contact distinguishes."""


@dataclass(frozen=True)
class Cause:
    """One claimed cause: a class of effects that the recording does not tell apart.

    Attributes:
        names: the effect, then its rivals.
        probability: that one of them is present.
        part: of the explanation that claims it.
        shares: of each effect in that probability, as far as evidence goes.
        elements: of each effect that were looked for, by its name.
    """

    names: tuple[str, ...]
    probability: float
    part: Part
    shares: tuple[float, ...] = ()
    elements: Mapping[str, Elements] = field(default_factory=dict)

    @property
    def open_elements(self) -> tuple[str, ...]:
        """Elements of the first effect where the recording leaves several."""
        first = self.elements.get(self.names[0])
        return first.names if first is not None and len(first.names) > 1 else ()


@dataclass(frozen=True, eq=False)
class Verdict:
    """Outcome of a diagnosis of readings' means.

    Attributes:
        verdict: ``none``, ``identified``, ``ambiguous`` or ``unknown``.
        causes: claimed, largest first; empty for none and unknown.
        explanation: the structure that the claims are from, also behind an unknown.
        probabilities: of none, unknown and each class as the leading cause.
    """

    verdict: str
    causes: tuple[Cause, ...]
    explanation: Explanation
    probabilities: Mapping[str, float]


def allowed(explanation: Explanation) -> float:
    """Gap that an explanation may leave: normal imperfections, and what its form misses."""
    return REST + missed(explanation)


def missed(explanation: Explanation) -> float:
    """Gap that the forms of an explanation's causes, only nearly right, may miss."""
    parts = explanation.finalist.parts
    named = [(p.index, p.share) for p in explanation.parts]
    total = sum(parts[k].effect.form_error * share for k, share in named if k is not None)
    alone = sum(share for k, share in named if k is not None)
    return total * max(1.0, explanation.closed / max(alone, 1e-12))


def complete(explanation: Explanation) -> bool:
    """Whether an explanation leaves no more residual than is normal."""
    return explanation.rest <= allowed(explanation)


def weights(ranking: Ranking) -> np.ndarray:
    """Probability of something unknown, then of each explanation (1 + E,)."""
    best, unknown = ranking.explanations[0], ranking.unknown
    if ranking.gap < CLAIMABLE:  # normal imperfections, whatever they look like
        unknown = -np.inf
    elif not complete(best):
        unknown = float(np.logaddexp(unknown, max(ranking.mixed, best.log_posterior + 3.0)))
    logs = np.array([unknown, *(e.log_posterior for e in ranking.explanations)])
    return np.asarray(np.exp(logs - logsumexp(logs)))


def decide(ranking: Ranking) -> Verdict:
    """Verdict of a ranking: which causes may be claimed, with their probabilities."""
    ranked, weight = ranking.explanations, weights(ranking)
    best = ranked[0]
    none = float(sum(w for w, e in zip(weight[1:], ranked, strict=True) if not e.parts))
    effects: dict[str, float] = {}
    for w, e in zip(weight[1:], ranked, strict=True):
        if e.parts:
            effects[e.parts[0].name] = effects.get(e.parts[0].name, 0.0) + float(w)
    others = {NONE: none, UNKNOWN: float(weight[0])}
    claim = next((e for e in ranked if e.parts), None)
    if claim is None:
        return Verdict(max(others, key=lambda n: others[n]), (), best, others)
    causes = _causes(claim, ranked, weight[1:], _outvoting(ranking, claim))
    probabilities = _by_class(causes, effects) | others
    lead = causes[0].probability
    if others[NONE] >= max(others[UNKNOWN], lead):
        return Verdict(NONE, (), best, probabilities)
    if others[UNKNOWN] >= lead or len(causes[0].names) > 1 + MOST_RIVALS:
        return Verdict(UNKNOWN, (), claim, probabilities)
    return Verdict(named(causes), causes, claim, probabilities)


def named(causes: Sequence[Cause]) -> str:
    """The verdict of claimed causes: ambiguous where one has a rival that other data separates."""
    plain = all(
        not c.open_elements and any(_inseparable(c.names, name) for name in c.names) for c in causes
    )
    return "identified" if plain else "ambiguous"


def _inseparable(names: Sequence[str], name: str) -> bool:
    """Whether no data without contact distinguishes an effect from each of some others."""
    return all(n == name or frozenset({n, name}) in INSEPARABLE for n in names)


def widened(verdict: Verdict, rivals: Sequence[str]) -> Verdict:
    """The verdict with more rivals of its leading cause; of too many nothing is claimed."""
    lead, *others = verdict.causes
    more = [n for n in rivals if n not in lead.names]
    names = (*lead.names, *more)
    if not more:
        return verdict
    probability = dict(verdict.probabilities)
    key = "|".join(names)
    probability[key] = probability.pop("|".join(lead.names), lead.probability)
    probability[key] += sum(probability.pop(n, 0.0) for n in more)
    if len(names) > 1 + MOST_RIVALS:
        return Verdict(UNKNOWN, (), verdict.explanation, probability)
    lead_shares = lead.shares or (1.0,) * len(lead.names)
    each = np.array([*lead_shares, *(min(lead_shares) for _ in more)])
    shares = tuple((each / each.sum()).tolist())
    wider = replace(
        lead, names=names, shares=shares, probability=max(lead.probability, probability[key])
    )
    causes = (wider, *others)
    word = named(causes) if verdict.verdict in ("identified", "ambiguous") else verdict.verdict
    return replace(verdict, verdict=word, causes=causes, probabilities=probability)


def tempered(verdict: Verdict, right: float) -> Verdict:
    """The verdict if such answers are right that often: no claim that is more likely wrong.

    What is taken from the leading answer goes to ``unknown``, from that to all others alike.
    """
    probability = dict(verdict.probabilities)
    lead = "|".join(verdict.causes[0].names) if verdict.causes else verdict.verdict
    spare = probability[lead] * (1.0 - right)
    probability[lead] -= spare
    others = [UNKNOWN] if lead != UNKNOWN else [n for n in probability if n != UNKNOWN] or [NONE]
    for name in others:
        probability[name] = probability.get(name, 0.0) + spare / len(others)
    causes = tuple(replace(c, probability=c.probability * right) for c in verdict.causes)
    if causes and probability[lead] <= probability[UNKNOWN]:
        return replace(verdict, verdict=UNKNOWN, causes=(), probabilities=probability)
    return replace(verdict, causes=causes, probabilities=probability)


def _outvoting(ranking: Ranking, claim: Explanation) -> frozenset[int]:
    """Explanations that predict left-out blocks clearly better than the claim does."""
    votes = ranking.votes
    place = next(k for k, e in enumerate(ranking.explanations) if e is claim)
    if place >= len(votes):
        return frozenset()
    return frozenset(k for k, v in enumerate(votes) if v > votes[place] + MARGIN)


def _causes(
    claim: Explanation,
    ranked: Sequence[Explanation],
    weight: np.ndarray,
    outvoting: Collection[int],
) -> tuple[Cause, ...]:
    causes = []
    for part in claim.parts:
        rest = claim.names - {part.name}
        score = {part.name: 0.0} | {n: CONTRIVED for n in part.imitators if n not in rest}
        score |= {n: 1.0 for n in part.twins if n not in rest}
        for k, (w, e) in enumerate(zip(weight, ranked, strict=True)):
            if rest <= e.names and len(e.names - rest) == 1:
                (name,) = e.names - rest
                weighed = 1.0 if k in outvoting else float(w) ** (1.0 / DOUBT)
                score[name] = max(score.get(name, 0.0), weighed)
        total = max(sum(score.values()), 1e-300)
        rivals = sorted((n for n in score if n != part.name), key=lambda n: -score[n])
        members = (part.name, *(n for n in rivals if score[n] > RIVAL * total))
        both = zip(weight, ranked, strict=True)
        present = sum(float(w) for w, e in both if e.names & set(members))
        shares = np.array([score[n] for n in members])
        fractions = tuple(float(s) for s in shares / max(shares.sum(), 1e-300))
        causes.append(Cause(members, present * part.probability, part, fractions))
    return tuple(causes)


def _by_class(causes: Sequence[Cause], effects: Mapping[str, float]) -> dict[str, float]:
    lead = causes[0].names
    probability = {"|".join(lead): sum(effects.get(n, 0.0) for n in lead)}
    return probability | {n: p for n, p in effects.items() if n not in lead}
