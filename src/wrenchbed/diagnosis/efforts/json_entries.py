"""Entries of ``diagnosis.json`` (docs/contracts.md) of joint efforts: causes, places, notes."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from wrenchbed.diagnosis.decision.decide import leading
from wrenchbed.diagnosis.efforts.dictionary import Dictionary
from wrenchbed.diagnosis.efforts.fitted_causes import Simulators
from wrenchbed.diagnosis.efforts.names import all_effects, place
from wrenchbed.diagnosis.efforts.residual_anomalies import Sign
from wrenchbed.diagnosis.efforts.search import Structure
from wrenchbed.diagnosis.efforts.sizes import parameters
from wrenchbed.diagnosis.efforts.weighed_causes import blocks, facts_of
from wrenchbed.diagnosis.evidence.search import NONE, UNKNOWN
from wrenchbed.diagnosis.explain.contributions import CLAIMABLE
from wrenchbed.diagnosis.explain.reliability import RIGHT_ELSEWHERE
from wrenchbed.diagnosis.explain.verdict import Cause, Key, Option, Verdict
from wrenchbed.diagnosis.gap.gap_bootstrap import Closure
from wrenchbed.diagnosis.gap.varies_with import entries, located, of_channels
from wrenchbed.diagnosis.json_entries import notes as of_gap
from wrenchbed.diagnosis.json_entries import with_rivals
from wrenchbed.diagnosis.next.blind import DETECTED, LEAST_MINOR
from wrenchbed.diagnosis.result import Scale, cause, families, rival
from wrenchbed.drives.identify import FRICTION

_OF_COMMANDS = (
    "efforts are tracking errors times stiffness; drive.constant is the servo's stiffness (a gain "
    "above 0: less of it), drive.delay how late it acts on its command, by a delay or a filter"
)
"""Note of a diagnosis of commands: what names of drive effects mean there."""
_REPEAT = "repeat this motion: what does not return there came from outside the arm"
_LONGER = "record a longer motion of all joints, at several speeds in both directions"
"""Next steps where no cause is settled: after a sign of trouble at one time, and without one."""


def which(s: Simulators, v: Verdict[Structure], gap: Closure) -> list[dict[str, Any]]:
    """Entries of ``which`` of diagnosis.json: the claimed causes with sizes and probabilities."""
    channels = {"channels": families(gap)}
    return [_entry(s, c, v.causes) | channels | {"closed_share": gap.shares[c.part.label]}
            for c in v.causes]  # fmt: skip


def _entry(s: Simulators, c: Cause, claimed: Sequence[Cause]) -> dict[str, Any]:
    """Entry of ``which`` of diagnosis.json for a cause, with its rivals: effects fitted in its
    place, at their likeliest joint. Other claimed causes are fitted beside it."""
    beside, by_effect = blocks([x for x in claimed if x is not c]), dict[str, dict[Key, float]]()
    for key, share in zip(c.keys, c.shares, strict=True):
        by_effect.setdefault(key[0], {})[key] = share
    of: dict[str, dict[str, Any]] = {}
    for effect, keys in by_effect.items():
        block = next(k for k, b in enumerate(s.d.blocks) if b.key == next(iter(keys)))
        block = c.part.index if effect == c.part.name and c.part.index is not None else block
        sizes = parameters(s.of((*beside, block)), block)
        sizes[all_effects()[effect].size.name] |= _stated(s.d, s.d.blocks[block].key)
        of[effect] = {"elements": [place(key) for key in keys], "parameters": sizes}
    first = of.pop(c.part.name)
    sizes = with_rivals(first["parameters"], first["elements"])
    shares = {name: c.probability * sum(by_effect[name].values()) for name in of}
    rivals = [rival(name, shares[name], of[name]) for name in of]
    return cause(c.part.name, c.probability, sizes, rivals, 0.0, first["elements"])


def _stated(d: Dictionary, key: Key) -> dict[str, float]:
    """Key ``stated`` with the stated number that a cause changes, SI; empty if none is stated."""
    effect, joint = key
    if effect == "tool.mass":
        return {"stated": float(d.scene.tool.mass)}
    stated = d.scene.drives.of(effect)[joint - 1] if joint and effect in FRICTION else 0.0
    return {"stated": float(stated)} if stated else {}


def minor(
    s: Simulators, every: Sequence[Option[Structure]], v: Verdict[Structure]
) -> list[dict[str, Any]]:
    """Entries of ``minor`` of diagnosis.json: causes of ``every`` that are too small to claim."""
    claimed = {key for c in v.causes for key in c.keys}
    result = []
    for c in leading(facts_of(s, every, 0, LEAST_MINOR)).causes if v.word != UNKNOWN else ():
        if c.part.share < CLAIMABLE and c.probability >= DETECTED and not claimed & {*c.keys}:
            believed = replace(c, probability=min(c.probability, RIGHT_ELSEWHERE))
            entry = _entry(s, believed, v.causes) | {"gap": c.part.share}
            del entry["closed_share"], entry["channels"]
            result.append(entry)
    return sorted(result, key=lambda entry: -entry["gap"])


def scales(d: Dictionary) -> dict[str, Scale]:
    """Row noise and residual that counts as a gap of 1 by channel (``tau1`` …, ``fx`` …)."""
    each = zip(d.channels, d.scene.channels, strict=True)
    return {column: Scale(c.noise.std, c.counts, unit) for c, (_, column, unit) in each}


def where(
    d: Dictionary, v: Verdict[Structure], gap: Closure, seen: Sequence[Sign] = ()
) -> list[dict[str, Any]]:
    """Entries of ``where`` of diagnosis.json: places of causes, else of signs, else of most gap."""
    if v.word == NONE:
        return []
    if v.causes:
        return entries([
            (c.part.name, place(c.part.key), gap.shares[c.part.label], 1.0 - c.probability,
             [f"{key[0]} ({place(key)})" for key in c.keys[1:]], gap.closed_from)
            for c in v.causes
        ])  # fmt: skip
    channels = [("drive" if j < d.scene.joints else "sensor", n)
                for j, (n, *_) in enumerate(d.scene.channels)]  # fmt: skip
    hints = [(channels[s.joint - 1], f"{s.text[:1].upper()}{s.text[1:]}") for s in seen[:2]]
    if hints:
        return [located(*of, 0.0, 1.0, f"{text}: no cause is claimed.") for of, text in hints]
    return of_channels(gap, channels)


def next_steps(v: Verdict[Structure], seen: Sequence[Sign] = ()) -> list[dict[str, Any]]:
    """Entries of ``next`` of diagnosis.json: actions that would separate causes from rivals, or
    show more of what no cause explains; ``seen``: signs of trouble."""
    steps = {
        all_effects()[c.part.name].remedy: list(dict.fromkeys((c.part.name, c.keys[1][0])))
        for c in v.causes
        if c.keys[1:] and all_effects()[c.part.name].remedy
    }
    if not steps and v.word not in (NONE, "identified"):
        steps[_REPEAT if seen and not v.causes else _LONGER] = []
    return [
        {"action": text, "separates": both, "gain": 0.0, "minutes": None, "plan": None,
         "sentence": f"{text[:1].upper()}{text[1:]}."}
        for text, both in steps.items()
    ]  # fmt: skip


def notes(
    d: Dictionary, v: Verdict[Structure], gap: Closure, seen: Sequence[Sign] = (), outside: str = ""
) -> tuple[str, ...]:
    """Notes on data, noise, signs and gap; ``outside``: unnamed cause that the gap is most like."""
    scene, noise = d.scene, [f"{s.noise:.2g} {s.unit}" for s in scales(d).values()]
    stated = ", ".join(k for k in scene.drives.value if scene.drives.known(k).any())
    fitted = scene.currents and not scene.drives.known("drive.constant").all()
    every = {
        f"noise of a row: {', '.join(noise)}, from what all effects together leave": True,
        f"stated: {stated}": stated,
        "no friction is stated: ordinary friction of every joint is fitted, and no cause":
            not stated,
        _OF_COMMANDS: scene.commanded,
        "drive constants are fitted, and no cause: they hold as the link masses do": fitted,
        **{f"not ordinary noise: {s.text}": True for s in seen},
        "ordinary errors of links and drives together may imitate a cause: none is never surer":
            v.word == NONE,
        "ordinary errors of all stated values together leave hardly a gap either: the cause is the "
        "likelier explanation, and held-out rows do not refute it":
            v.causes and gap.calibrated.high < 1.0,
        f"what has no name looks most like: {outside}": outside,
    }  # fmt: skip
    result = [sentence for sentence, said in every.items() if said]
    return (*result, *of_gap(gap, (), unknown=False))
