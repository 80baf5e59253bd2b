"""The decision: which verdict a recording gets. Nothing else makes or changes a verdict.

`decide` is a pure function of the evidence for every set of causes, of gaps on held-out rows, and
of the share of similar claims that were right. Its rules are in `RULES`, in the order in which they
act. ``scripts/ablations`` measures what each changes, see ``docs/explanation/decision.md``.
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from wrenchbed.diagnosis.decision.facts import Decision, Facts
from wrenchbed.diagnosis.evidence.search import NONE, PARTIAL, UNKNOWN
from wrenchbed.diagnosis.explain.contributions import CLAIMABLE
from wrenchbed.diagnosis.explain.elements import RIVAL
from wrenchbed.diagnosis.explain.reliability import key_of, tempered
from wrenchbed.diagnosis.explain.verdict import Cause, Elements, Key, Option, Part, S, Verdict
from wrenchbed.diagnosis.gap.gap_bootstrap import Closure, Interval

LARGEST_NONE = 1.0
"""Largest calibrated gap beyond noise at which the verdict may be ``none`` (docs/contracts.md)."""
LEAST = 0.5
"""Least gap that a claimed cause closes; below it is an imperfection (docs/contracts.md)."""
MOST = 0.5
"""Closed share of the gap below which the verdict is ``partial`` (docs/contracts.md)."""
BESIDE_REST = 0.15
"""Least gap that a cause closes, as a share of a rest that surely counts and that no cause
explains; smaller ones were wrong (tuned on ``scripts/real_faults``, seed 77)."""
NEARLY_ALL = 0.9
"""Closed share of the gap from which causes stand beside unusual noise elsewhere; of 12 outside
faults of efforts (``blind make --world efforts --seed 7711``) eight show such noise, and none of
them has a cause to claim."""
DOUBTFUL = 0.5
"""Largest probability of a cause beside a sure one if the interval of its closed gap holds 0."""
WITHDRAWN = 0.05
"""Share of its probability that a withdrawn answer keeps: how often a 95 % interval errs."""
MOST_RIVALS = 4
"""Most rivals of a named cause (docs/contracts.md): more than five candidates tell nothing."""
FIRM = 0.75
"""Least probability of a cause that is claimed although ordinary errors imitate it: 3 to 1."""
CONTRIVED = 0.05
"""Least weight, where the cause has at most 1, of a rival that makes the same readings only with
numbers that happen to fit: evidence against it is as uncertain as its assumed sizes."""

Rule = Callable[[Facts[S], Verdict[S], Closure], Verdict[S]]


def decide(facts: Facts[S], without: Collection[str] = ()) -> Decision[S]:
    """Verdict on a recording (word, causes with rivals, probabilities) and its held-out gaps;
    ``without``: names of rules to leave out, to measure what they change."""
    verdict = leading(facts, without)
    gap = facts.measure(verdict)
    for name, rule in RULES.items():
        if name in without:
            continue
        parts = [c.part for c in verdict.causes]
        verdict = rule(facts, verdict, gap)
        if [c.part for c in verdict.causes] != parts:
            gap = facts.measure(verdict)
    if gap.calibrated.low - max(gap.floor, 0.0) > LARGEST_NONE:  # held-out rows refute `none`
        chances = {NONE: 0.0, UNKNOWN: 0.0} | dict(verdict.probabilities)
        unknown = chances[UNKNOWN] + chances[NONE]
        verdict = replace(verdict, probabilities=chances | {NONE: 0.0, UNKNOWN: unknown})
    return Decision(verdict, gap)


def leading(facts: Facts[S], without: Collection[str] = ()) -> Verdict[S]:
    """Verdict by evidence alone: the likeliest of none, unknown and the leading class of causes.

    Sets of causes that claim the same names are one claim. An effect that explains the recording in
    a cause's place is its rival, unless ``without`` names the rule ``rivals``.
    """
    mass: dict[frozenset[Key], float] = {}
    first: dict[frozenset[Key], Option[S]] = {}
    leads: dict[str, float] = {}
    for o in facts.options:
        mass[o.keys] = mass.get(o.keys, 0.0) + o.probability
        first.setdefault(o.keys, o)
        if o.parts:
            leads[o.parts[0].name] = leads.get(o.parts[0].name, 0.0) + o.probability
    others = {NONE: mass.pop(frozenset(), 0.0), UNKNOWN: facts.unknown}
    if not mass:
        word = max(others, key=lambda n: others[n])
        return Verdict(word, (), facts.options[0].explanation, others)
    claim = first[max(mass, key=lambda keys: mass[keys])]
    each = list[Cause]()
    for part in claim.parts:
        each.append(_cause(facts, mass, claim, part, without, {k for c in each for k in c.keys}))
    main, *beside = each
    causes = (main, *(c for c in beside if len(c.names) <= 1 + MOST_RIVALS))
    members = (names := main.names)[: 1 + MOST_RIVALS]
    probability = {"|".join(members): sum(leads.get(n, 0.0) for n in members)}
    probability |= {n: p for n, p in leads.items() if n not in members} | others
    lead = causes[0].probability
    if others[NONE] >= max(others[UNKNOWN], lead):
        return Verdict(NONE, (), facts.options[0].explanation, probability)
    if others[UNKNOWN] >= lead or len(names) > 1 + MOST_RIVALS:
        alike = main.keys if others[UNKNOWN] < lead else ()
        return Verdict(UNKNOWN, (), claim.explanation, probability, alike)
    return Verdict(_word(causes), causes, claim.explanation, probability)


def _cause(
    facts: Facts[S], mass: Mapping[frozenset[Key], float], claim: Option[S], part: Part,
    without: Collection[str], taken: Collection[Key],
) -> Cause:  # fmt: skip
    """Cause, with rivals, of the part ``part`` of the leading option ``claim``. ``mass``: chance
    of each set of causes; ``without``: rules left out; ``taken``: keys of other causes' members."""
    beside = claim.keys - {part.key}
    score = {part.key: 0.0} | {(n, None): CONTRIVED for n in part.imitators}
    score |= {(n, None): 1.0 for n in part.twins}
    score = {key: weight for key, weight in score.items() if key not in beside}
    for keys, p in mass.items():
        if "rivals" not in without and beside <= keys and len(keys - beside) == 1:
            (key,) = keys - beside
            score[key] = max(score.get(key, 0.0), p ** (1.0 / facts.doubt))
    total = max(sum(score.values()), 1e-300)
    rivals = sorted((k for k in score if k != part.key), key=lambda k: -score[k])
    alike = (k for k in rivals if score[k] > RIVAL * total and k not in taken)
    members = (part.key, *alike)
    present = sum(p for keys, p in mass.items() if keys & set(members))
    within = np.array([score[k] for k in members])
    shares = tuple((within / max(float(within.sum()), 1e-300)).tolist())
    return Cause(members, min(present, 1.0) * part.probability, part, shares)


def _word(causes: Iterable[Cause]) -> str:
    """``ambiguous`` if other data could separate a cause from a rival, else ``identified``."""
    return "identified" if all(c.plain for c in causes) else "ambiguous"


def small(gap: Closure) -> bool:
    """Whether the calibrated gap is so small that there may be no cause: the larger of the gap's
    lower end and the mean gap of single channels, as imperfections lack noise's correlation."""
    floor = max(gap.floor, 0.0)
    return max(gap.channels, gap.calibrated.low) - floor <= LARGEST_NONE


def closes(member: Interval | None) -> bool:
    """Whether ``member``, the held-out gap that a cause closes, is at least `LEAST`; None: no."""
    return member is not None and member.value >= LEAST


def surely(member: Interval | None) -> bool:
    """Whether ``member``, held-out gap that a cause closes, is ≥ `LEAST` with interval above 0."""
    return member is not None and closes(member) and member.low > 0.0


def held_out(facts: Facts[S], verdict: Verdict[S], gap: Closure) -> Verdict[S]:
    """Drop causes that close no part of the gap on held-out rows; withdraw the claim if none stays.

    The cause that closes most leads. A cause whose interval contains zero is doubtful beside a sure
    one: few poses show it. A wrong stated number is fitted away and closes nothing afterwards; its
    own gap decides. Effects in `Facts.seen`, as a limit that few poses reach, are exempt.
    """
    while verdict.causes:
        shown = _closing(facts, verdict, gap)
        if not shown and _imitated(facts, verdict, gap):
            return verdict
        if not shown:
            return withdrawn(verdict, NONE if small(gap) else UNKNOWN)
        fewer = len(shown) < len(verdict.causes)
        verdict = only(verdict, shown)
        if not fewer:
            break
        gap = facts.measure(verdict)
    return verdict


def confirmed(cause: Cause, gap: Closure) -> bool:
    """Whether channels other than the wrench confirm a cause, on rows that no fit used."""
    return surely(gap.further.get(cause.part.label))


def _stands(facts: Facts[S], cause: Cause, gap: Closure) -> bool:
    """Whether values of readings, or channels beside the wrench, support a cause by themselves."""
    return cause.part.name in facts.seen or confirmed(cause, gap)


def _closing(facts: Facts[S], verdict: Verdict[S], gap: Closure) -> tuple[Cause, ...]:
    """Causes that close a gap on held-out rows, largest first; those whose interval has 0 last."""
    together = gap.closed is not None and gap.closed.low > 0.0
    in_all = gap.in_all is not None and gap.in_all.low > 0.0
    members = {c.part.label: gap.members.get(c.part.label) for c in verdict.causes}
    back = {n: 0.0 if m is None else max(m.value, 0.0) for n, m in members.items()}

    def sure(c: Cause) -> bool:
        shown = together or in_all or c.part.index is None
        return c.part.name in facts.seen or (shown and surely(members[c.part.label]))

    counted = [
        c for c in verdict.causes if c.part.index is None or _stands(facts, c, gap)
        or not gap.outweighed(c.part.label, BESIDE_REST, LARGEST_NONE)
    ]  # fmt: skip
    in_order = sorted(counted, key=lambda c: -back[c.part.label])
    certain = [c for c in in_order if sure(c)]
    if not certain or not together:
        return tuple(certain)
    doubtful = [c for c in in_order if not sure(c) and closes(members[c.part.label])]
    capped = (replace(c, probability=min(c.probability, DOUBTFUL)) for c in doubtful)
    return (*certain, *capped)


def _imitated(facts: Facts[S], verdict: Verdict[S], gap: Closure) -> bool:
    """Whether ordinary errors of all stated values together imitate causes that the evidence names
    and no held-out row refutes: they close some of the little that these errors leave, or are wrong
    numbers that close the configured gap."""
    sure = min(c.probability for c in verdict.causes) >= FIRM
    if not (facts.ordinary_fitted and sure and small(gap)) or gap.closed is None:
        return False
    return gap.closed.value > 0.0 and all(member.high >= 0.0 for member in gap.members.values())


def size(facts: Facts[S], verdict: Verdict[S], gap: Closure) -> Verdict[S]:
    """Withdraw ``none`` if the gap after the fit of bias, mass and CoG is large (or if the
    unexplained residual counts as noise), ``unknown`` if there is no gap."""
    if verdict.word == NONE and (facts.own_rest or not small(gap)):
        return withdrawn(verdict, UNKNOWN)
    hardly = gap.calibrated.high - max(gap.floor, 0.0) < CLAIMABLE and small(gap)
    return withdrawn(verdict, NONE) if verdict.word == UNKNOWN and hardly else verdict


def partial(facts: Facts[S], verdict: Verdict[S], gap: Closure) -> Verdict[S]:
    """Turn the word into ``partial`` where the causes close less than half of the gap."""
    seen = any(c.part.name in facts.seen for c in verdict.causes)
    most = gap.closed is not None and (gap.closed.low > 0.0 or seen) and gap.closed.value >= MOST
    return replace(verdict, word=PARTIAL) if verdict.causes and not most else verdict


def reliable(facts: Facts[S], verdict: Verdict[S], gap: Closure) -> Verdict[S]:
    """Verdict with probabilities times `Facts.right`, the share of such answers that were right.

    What the leading answer loses goes to ``unknown``; a claim that is then no likelier than
    ``unknown`` becomes it. Causes that channels beside the wrench confirm are kept as they are.
    Where each channel has its own device, each cause is judged as if it were the leading one.
    """
    right, lead = facts.right(verdict, gap), key_of(verdict)
    alone = [replace(verdict, causes=(c,)) if gap.apart else verdict for c in verdict.causes]
    causes = tuple(
        c if _stands(facts, c, gap) else replace(c, probability=c.probability * facts.right(v, gap))
        for c, v in zip(verdict.causes, alone, strict=True)
    )
    if causes and _stands(facts, causes[0], gap):
        return replace(verdict, causes=causes)
    probability = tempered(verdict.probabilities, lead, right)
    if causes and probability[lead] <= probability[UNKNOWN]:
        return replace(verdict, word=UNKNOWN, causes=(), probabilities=probability)
    return replace(verdict, causes=causes, probabilities=probability)


def probable(facts: Facts[S], verdict: Verdict[S], gap: Closure) -> Verdict[S]:
    """Keep causes of probability `Facts.least` or more, which beside a contact few rows separate,
    but none whose size may be 0."""
    some = (c for c in verdict.causes if c.part.key not in gap.untold)
    kept = tuple(c for c in some if c.probability >= facts.least)
    if kept == verdict.causes:
        return verdict
    return only(verdict, kept) if kept else withdrawn(verdict, UNKNOWN)


RULES: Mapping[str, Rule[Any]] = {
    "held out": held_out, "size": size, "partial": partial, "reliability": reliable,
    "contact": probable,
}  # fmt: skip
"""Rules by name, in the order in which they act after `leading`, whose own is ``rivals``."""


def beside_own_rest(
    first: Decision[S],
    again: Callable[[], Decision[S]],
    rivals: Callable[[Verdict[S]], Sequence[Key]],
    changing: Callable[[Verdict[S], Collection[str]], str],
) -> tuple[Decision[S], str]:
    """Decision beside a residual that no effect explains, as real robots leave it, and a sentence
    on a refuted cause that comes nearest; empty if there is none.

    Evidence takes that residual for white noise, so rivals are effects that held-out rows do not
    separate from the leading cause. A cause that is named only once the residual counts as noise
    must have a constant size.

    ``first`` counts the sensor's noise alone, ``again`` makes the decision with the residual as
    noise. ``rivals`` returns effects that close as much as a verdict's leading cause on held-out
    rows, ``changing`` a sentence on a cause, of those named, whose size changes; else empty.
    """
    if first.settled:
        return replace(first, verdict=widened(first.verdict, rivals(first.verdict))), ""
    second = again()
    before, now = ({c.part.name for c in d.verdict.causes} for d in (first, second))
    if now <= before:
        return first, ""
    if sentence := changing(second.verdict, now - before):
        return first, sentence
    return replace(second, verdict=widened(second.verdict, rivals(second.verdict))), ""


def conclude(
    decision: Decision[S],
    elements: Sequence[Mapping[str, Elements]],
    signs: Sequence[str] = (),
    between: Sequence[tuple[str, float]] = (),
) -> Verdict[S]:
    """Final verdict, with the findings that means of readings do not show.

    ``elements``: for each cause the joints, links or axes that explain as well, by effect;
    ``signs``: sentences on unusual noise where no cause is claimed: then none is named, unless the
    causes close `NEARLY_ALL` of the gap;
    ``between``: effects that show between rows only, with probabilities, surest first.
    """
    verdict, closed = decision.verdict, decision.gap.closed
    if signs and verdict.word != UNKNOWN and (closed is None or closed.low < NEARLY_ALL):
        verdict, elements = withdrawn(verdict, UNKNOWN), ()
    both = zip(verdict.causes, elements, strict=True)
    causes = tuple(replace(c, elements=e) for c, e in both)
    word = _word(causes) if causes and verdict.word != PARTIAL else verdict.word
    probability = dict(verdict.probabilities)
    if between and not causes:
        word, (effect, present) = "identified" if word == NONE else word, between[0]
        spare = probability.get(NONE, 0.0) * present
        probability[NONE] = probability.get(NONE, 0.0) - spare
        probability[effect] = probability.get(effect, 0.0) + spare
    total = sum(probability.values())
    probability = {k: v / total for k, v in probability.items()}
    for lead in causes[:1]:  # it leads no more often than it is there
        name = "|".join(lead.names)
        more = max(probability.get(name, 0.0) - lead.probability, 0.0)
        probability[name] = probability.get(name, 0.0) - more
        probability[UNKNOWN] = probability.get(UNKNOWN, 0.0) + more
    return replace(verdict, word=word, causes=causes, probabilities=probability)


def beside_contact(
    verdict: Verdict[S], name: str, probability: float, gap: Closure, *, at_a_point: bool
) -> Verdict[S]:
    """Verdict on untouched rows, completed by a contact: the effect ``name`` with its probability.

    Without ``at_a_point``, if the force acts at no one point, the whole answer is ``unknown``.
    """
    if not at_a_point:
        return replace(verdict, word=UNKNOWN, causes=(), probabilities={UNKNOWN: 1.0})
    word = "identified" if verdict.word in (NONE, UNKNOWN) else verdict.word
    if verdict.word == UNKNOWN and not small(gap):
        word = PARTIAL
    rest = {k: (1.0 - probability) * v for k, v in verdict.probabilities.items()}
    return replace(verdict, word=word, probabilities={name: probability} | rest)


def withdrawn(verdict: Verdict[S], instead: str) -> Verdict[S]:
    """Verdict ``instead`` (`none`, `unknown`); the withdrawn answer keeps a small probability.

    Causes that become `unknown` lower the probability of `none` as well, since there is a gap; an
    `unknown` that becomes `none` lowers those of all causes.
    """
    probability = {NONE: 0.0, UNKNOWN: 0.0} | dict(verdict.probabilities)
    fallen = {NONE} if verdict.word == NONE else set(probability) - {instead}
    if verdict.causes and instead == NONE:
        fallen -= {UNKNOWN}
    probability[instead] += (1.0 - WITHDRAWN) * sum(probability[n] for n in fallen)
    probability |= {n: WITHDRAWN * probability[n] for n in fallen}
    return replace(verdict, word=instead, causes=(), probabilities=probability)


def only(verdict: Verdict[S], kept: tuple[Cause, ...]) -> Verdict[S]:
    """Verdict with the causes ``kept``, of which the first leads.

    The first keeps at most the probability that it is present; the rest goes to ``unknown``.
    """
    probability = dict(verdict.probabilities)
    before, now = ("|".join(c[0].names) for c in (verdict.causes, kept))
    if before != now:
        together = probability.get(now, 0.0) + probability.pop(before, 0.0)
        probability[now] = min(together, kept[0].probability)
        probability[UNKNOWN] = probability.get(UNKNOWN, 0.0) + together - probability[now]
    return replace(verdict, word=_word(kept), causes=kept, probabilities=probability)


def widened(verdict: Verdict[S], rivals: Sequence[Key]) -> Verdict[S]:
    """Verdict with more rivals of its leading cause; ``unknown`` if they are too many."""
    new = [key for cause in verdict.causes[:1] for key in rivals if key not in cause.keys]
    if not new:
        return verdict
    lead, *others = verdict.causes
    keys, more = (*lead.keys, *new), [n for n in dict(new) if n not in lead.names]
    probability, key = dict(verdict.probabilities), "|".join((*lead.names, *more))
    probability[key] = probability.pop("|".join(lead.names), lead.probability)
    probability[key] += sum(probability.pop(n, 0.0) for n in more)
    if len(keys) > 1 + MOST_RIVALS:
        probability[UNKNOWN] = probability.get(UNKNOWN, 0.0) + probability.pop(key)
        return replace(verdict, word=UNKNOWN, causes=(), probabilities=probability, alike=keys)
    shares = lead.shares or (1.0,) * len(lead.keys)
    each = np.array([*shares, *(min(shares) for _ in new)])
    wider = replace(
        lead, keys=keys, shares=tuple((each / each.sum()).tolist()),
        probability=max(lead.probability, probability[key]),
    )  # fmt: skip
    causes = (wider, *others)
    word = _word(causes) if verdict.word != PARTIAL else PARTIAL
    return replace(verdict, word=word, causes=causes, probabilities=probability)
