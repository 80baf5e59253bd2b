"""Entries of ``diagnosis.json`` of joint efforts: causes, places, notes, what next."""

from collections.abc import Sequence
from typing import Any

from wrenchbed.diagnosis.answer import notes as of_gap
from wrenchbed.diagnosis.answer import with_rivals
from wrenchbed.diagnosis.decision.decide import leading
from wrenchbed.diagnosis.efforts.dictionary import Dictionary
from wrenchbed.diagnosis.efforts.fitted_causes import Simulators
from wrenchbed.diagnosis.efforts.names import all_effects, place
from wrenchbed.diagnosis.efforts.options import BELIEVED, blocks, facts_of
from wrenchbed.diagnosis.efforts.search import Structure
from wrenchbed.diagnosis.efforts.signs import Sign
from wrenchbed.diagnosis.efforts.sizes import parameters
from wrenchbed.diagnosis.evidence.search import NONE, UNKNOWN
from wrenchbed.diagnosis.explain.contributions import CLAIMABLE
from wrenchbed.diagnosis.explain.verdict import Cause, Key, Option, Verdict
from wrenchbed.diagnosis.gap.gaps import Closure
from wrenchbed.diagnosis.gap.where import entries, located, of_channels
from wrenchbed.diagnosis.next.blind import DETECTED, LEAST_MINOR
from wrenchbed.diagnosis.result import Scale, cause, families, rival

_OF_COMMANDS = (
    "efforts are tracking errors times stiffness; drive.constant is the servo's stiffness (a gain "
    "above 0: less of it), drive.delay how late it acts on its command, by a delay or a filter"
)
"""What the names of a diagnosis of commands mean."""


def which(s: Simulators, v: Verdict[Structure], gap: Closure) -> list[dict[str, Any]]:
    """Entries of ``which``: the claimed causes with sizes and probabilities."""
    result = list[dict[str, Any]]()
    for c in v.causes:
        entry = _entry(s, c, blocks([x for x in v.causes if x is not c]), c.probability)
        share = {"closed_share": gap.shares[c.part.label], "channels": families(gap)}
        result.append(entry | share)
    return result


def _entry(s: Simulators, c: Cause, beside: Sequence[int], probability: float) -> dict[str, Any]:
    """Entry of ``which`` for a cause with joints and rivals; other causes are fitted beside it."""
    assert c.part.index is not None
    numbers = parameters(s.of((*beside, c.part.index)), c.part.index)
    elements = [place(key) for key in c.keys if key[0] == c.part.name]
    numbers = with_rivals(numbers, elements)
    return cause(c.part.name, probability, numbers, _rivals(s, c, beside), 0.0, elements)


def _rivals(s: Simulators, c: Cause, beside: Sequence[int]) -> list[dict[str, Any]]:
    """Entries of ``rivals``: effects fitted in a cause's place, with the parameters of the
    likeliest joint. ``beside``: indices of the other causes that are fitted."""
    by_effect: dict[str, list[tuple[Key, float]]] = {}
    for key, share in zip(c.keys[1:], c.shares[1:], strict=True):
        if key[0] != c.part.name:
            by_effect.setdefault(key[0], []).append((key, share))
    result = []
    for effect, keys in by_effect.items():
        block = next(k for k, b in enumerate(s.d.blocks) if b.key == keys[0][0])
        elements = [place(key) for key, _ in keys]
        numbers = {"elements": elements, "parameters": parameters(s.of((*beside, block)), block)}
        probability = c.probability * sum(share for _, share in keys)
        result.append(rival(effect, probability, numbers))
    return result


def minor(
    s: Simulators, every: Sequence[Option[Structure]], v: Verdict[Structure]
) -> list[dict[str, Any]]:
    """Entries of ``minor``: detected causes, with rivals, that are too small to be claimed."""
    claimed = {key for c in v.causes for key in c.keys}
    result = []
    for c in leading(facts_of(s, every, 0, LEAST_MINOR)).causes if v.word != UNKNOWN else ():
        if c.part.share < CLAIMABLE and c.probability >= DETECTED and not claimed & {*c.keys}:
            entry = _entry(s, c, blocks(v.causes), min(c.probability, BELIEVED))
            del entry["closed_share"], entry["channels"]
            result.append(entry | {"gap": c.part.share})
    return sorted(result, key=lambda entry: -entry["gap"])


def scales(d: Dictionary) -> dict[str, Scale]:
    """Noise of a row, and residual that counts as a gap of 1, of each channel."""
    each = zip(d.scene.columns, d.channels, d.scene.units, strict=True)
    return {name: Scale(c.noise.std, c.counts, unit) for name, c, unit in each}


def where(
    d: Dictionary, v: Verdict[Structure], gap: Closure, seen: Sequence[Sign] = ()
) -> list[dict[str, Any]]:
    """Entries of ``where``: of each claimed cause, else hints at joints with most of the gap."""
    if v.word == NONE:
        return []
    if v.causes:
        each = ((c, gap.shares[c.part.label]) for c in v.causes)
        return entries([(c.part.name, place(c.part.key), s, 1.0 - c.probability) for c, s in each])
    channels = [("drive" if j < d.scene.joints else "sensor", n)
                for j, n in enumerate(d.scene.channels)]  # fmt: skip
    hints = [(channels[s.joint - 1], f"{s.text[:1].upper()}{s.text[1:]}") for s in seen[:2]]
    if hints:
        return [located(*of, 0.0, 1.0, f"{text}: no cause is claimed.") for of, text in hints]
    return of_channels(gap, channels)


def next_steps(v: Verdict[Structure]) -> list[dict[str, Any]]:
    """Entries of ``next``: actions that would separate causes from their rivals."""
    steps: dict[str, dict[str, Any]] = {}
    for c in (c for c in v.causes if c.keys[1:]):
        text = all_effects()[c.part.name].remedy
        both = list(dict.fromkeys((c.part.name, c.keys[1][0])))
        sentence = f"{text[:1].upper()}{text[1:]}."
        steps[text] = {"action": text, "separates": both, "gain": 0.0, "sentence": sentence}
    return [step for text, step in steps.items() if text]


def notes(
    d: Dictionary, v: Verdict[Structure], gap: Closure, seen: Sequence[Sign] = (), outside: str = ""
) -> tuple[str, ...]:
    """Notes on data, noise and remaining gap; ``outside``: unnamed cause that it resembles."""
    scene, noise = d.scene, [f"{s.noise:.2g} {s.unit}" for s in scales(d).values()]
    result = [f"noise of a row: {', '.join(noise)}, from what all effects together leave"]
    stated = [k for k in scene.drives.value if scene.drives.known(k).any()]
    result.append(
        f"stated: {', '.join(stated)}" if stated
        else "no friction is stated: ordinary friction of every joint is fitted, and no cause"
    )  # fmt: skip
    if scene.commanded:
        result.append(_OF_COMMANDS)
    if scene.currents and not scene.drives.known("drive.constant").all():
        result.append("drive constants are fitted, and no cause: they hold as the link masses do")
    result += [f"not ordinary noise: {s.text}" for s in seen]
    if v.word == NONE:
        result.append(
            "ordinary errors of links and drives together may imitate a cause: none is never surer"
        )
    if v.causes and gap.calibrated.high < 1.0:
        result.append(
            "ordinary errors of all stated values together leave hardly a gap either: the cause is "
            "the likelier explanation, and held-out rows do not refute it"
        )
    if outside:
        result.append(f"what has no name looks most like: {outside}")
    return (*result, *of_gap(gap, (), unknown=False))
