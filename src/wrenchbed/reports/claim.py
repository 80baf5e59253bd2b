"""A claimed cause as every reader meets it: one sentence for page, terminal and rerun."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.diagnosis.explain.elements import listed
from wrenchbed.diagnosis.prepare.configured_simulator import STATED
from wrenchbed.diagnosis.result import named_by
from wrenchbed.effects.base import Effect
from wrenchbed.pages import numbers

MOST_SIZES = 3
"""Most parameters of a cause in its sentence and on the first screen."""
_WHERE = ("m", "1")
"""Units of numbers of where or how a cause acts, as are times; those of size are shown first."""
_STANDS_OUT = 3.0
"""A joint's amplitude beyond so many standard uncertainties counts as different from 0."""
_NUMBERED = re.compile(r"\.[a-z]*(1?\d)$")
"""Number at the end of ``offset.q3`` or ``twist.2``, up to 19 joints; not of the length ``d41``."""
_SPACES = str.maketrans("._", "  ")
_DIFFERENCES = (*STATED, "joint.offset", "link.length", "sensor.crosstalk", "sensor.drift")
"""Effects whose sizes are differences from what is stated or nominal, so that they have a sign."""


@dataclass(frozen=True)
class Size:
    """A parameter of a cause that is a quantity.

    Attributes:
        key: its name in diagnosis.json.
        name: its name in words.
        brief: text of value ± standard uncertainty with unit.
        value: like ``brief``; of a wrong stated number also the stated value and the right one.
    """

    key: str
    name: str
    brief: str
    value: str


class Claim:
    """An entry of ``which`` in diagnosis.json in words, for headline, cards and tables.

    Args:
        entry: the entry.
        wording: title with joint, needed where the cause is none of the registry's effects.
        rivals: (name, title) of each rival, needed likewise.

    Attributes:
        name: name of the effect.
        title: what it is, with the joint's number where one joint has it; begins small.
        choices: its discrete parameters, such as form or joint: (name in diagnosis.json, text).
        choice: these as one text, without what the title says; may be empty.
        sizes: all quantities, in the order of diagnosis.json.
        figures: the most certain quantities, at most `MOST_SIZES`.
        against: whether the figures are differences from what the metadata state.
        probability: text of the probability that the cause is present.
        closed: text of the share of the gap that it closes; a dash if no pose's mean shows it.
        rivals: (name, title) of effects that this recording does not distinguish from it.
    """

    def __init__(
        self, entry: Mapping[str, Any], wording: str = "",
        rivals: Sequence[tuple[str, str]] | None = None,
    ) -> None:  # fmt: skip
        self.name, joint = str(entry["effect"]), _one_of_joints(entry)
        values: Mapping[str, Any] = entry["parameters"]
        size: Mapping[str, Any] = entry.get("size") or {}
        quantities = {n: v for n, v in {**size, **values}.items() if "unit" in v}
        if entry.get("combination") is not None:
            quantities = {"sum": entry["combination"]}
        known, differs = quantities.items(), self.name in _DIFFERENCES
        sizes = {n: _size(n, v, signed=differs or bool(wording and v.get("std"))) for n, v in known}
        ranked = [n for n in sizes if n in size] or list(sizes)
        if len(ranked) > MOST_SIZES:
            unsure = {n: abs((v.get("std") or np.inf) / (v["value"] or 1e-300)) for n, v in known}
            where = {n for n, v in known if v["unit"] in _WHERE and not n.startswith("x.")}
            ranked.sort(key=lambda n: (n in where or n.startswith("time"), unsure[n]))
        of_joint = str(effect(self.name).title_of_joint) if joint and not wording else ""
        choices = {n: f"{parameter(n)} {numbers.quantity(n, v)}"
                   for n, v in values.items() if "unit" not in v}  # fmt: skip
        said = {"form", "joint"} if wording or of_joint else {"form"}
        said |= {
            n for n in choices if any(f".{values[n]['value']}." in f"{q}." for q in quantities)
        }
        self.choice = ", ".join(text for n, text in choices.items() if n not in said)
        several, self.against = list(entry.get("elements", ())), self.name in STATED
        between_rows = not wording and effect(self.name).between_rows
        if len(several) > 1 and not (joint or wording or self.against or between_rows):
            self.choice = f"{'into ' if 'of' in values else ''}{listed(several)}"
        closed = entry.get("closed_share")
        self.title = wording or of_joint.format(joint=joint) or title(self.name)
        self.choices, self.sizes = tuple(choices.items()), tuple(sizes.values())
        self.figures = tuple(sizes[n] for n in ranked[:MOST_SIZES])
        self.probability = numbers.chance(float(entry["probability"]))
        self.closed = "–" if closed is None else f"{numbers.percent(float(closed))} %"
        named = [(n, title(n)) for n in named_by(entry)[1:]] if rivals is None else rivals
        self.rivals = tuple(named)

    @property
    def names(self) -> str:
        """Names of the effect and of those that look alike, as ``base.tilt or cable.pull``."""
        return " or ".join((self.name, *(name for name, _ in self.rivals)))

    def sentence(self, most: int = MOST_SIZES) -> str:
        """The claim with its first ``most`` figures, a single one in brief: ``Joint 2 is compliant
        and deflects under gravity: stiffness 9080 ± 950 N·m/rad.``"""
        words = [self.choice] if self.choice else []
        alone = len(self.figures) == 1 < most
        words += [f"{x.name} {x.value if alone else x.brief}" for x in self.figures[:most]]
        values = f": {', '.join(words)}" if words else ""
        others = "".join(f"; or {title}" for _, title in self.rivals)
        return f"{capital(self.title)}{values}{others}."


def _size(key: str, entry: Mapping[str, Any], *, signed: bool) -> Size:
    """Put quantity ``key`` of a cause's ``entry`` into words; ``signed``: with a sign."""
    text, beside = numbers.quantity(key, entry, signed=signed), ""
    if over := entry.get("over"):
        text += f" over {over:,.{0 if over >= 10 else 1}f} s"
    if (stated := entry.get("stated")) and signed:
        found = numbers.quantity(key, {**entry, "value": stated + entry["value"]})
        beside = f" (stated {numbers.quantity(key, {**entry, 'value': stated, 'std': None})}"
        beside += f", found {found})"
    elif stated:
        text += f" instead of {numbers.rough(key, stated, entry['unit'], entry['value'])}"
    return Size(key, "together" if key == "sum" else parameter(key), text, text + beside)


def place(entry: Mapping[str, Any]) -> str:
    """Text of where an entry of ``which`` in diagnosis.json acts: ``joint 2``, ``joint 2, 3 or 4``,
    ``joints 3 and 5``, ``all joints``, ``sensor``."""
    part = str(entry["effect"]).split(".")[0].replace("drive", "joint")
    if joint := _one_of_joints(entry):
        return f"{part} {joint}"
    numbered = joints(entry) if part in ("joint", "link") else []
    if numbered:
        return f"{part}{'s' if len(numbered) > 1 else ''} {listed(map(str, numbered), 'and')}"
    if one := [e for e in entry.get("elements", ()) if f"length.{e}" in entry["parameters"]]:
        return f"{part} {one[0]}"
    return f"all {part}s" if part in ("joint", "link") else part


def joints(entry: Mapping[str, Any]) -> list[int]:
    """Numbers, from 1, of the joints or links of an entry of ``which``: alternatives if it is one
    unknown joint, else those whose amplitudes exceed three standard uncertainties."""
    if any_of := joints_or(entry):
        return any_of
    clear = (
        name
        for name, p in entry["parameters"].items()
        if p.get("std") and abs(float(p["value"])) > _STANDS_OUT * float(p["std"])
    )
    return sorted({int(match[1]) for match in map(_NUMBERED.search, clear) if match})


def joints_or(entry: Mapping[str, Any]) -> list[int]:
    """Numbers, from 1, of the joints one of which, unknown which, is cause ``entry``; or empty."""
    joint = entry["parameters"].get("joint", {})
    value = joint.get("value")
    return sorted([value, *joint.get("rivals", [])]) if isinstance(value, int) else []


def _one_of_joints(entry: Mapping[str, Any]) -> str:
    """Text ``2, 3 or 4`` of the joints one of which, unknown which, is cause ``entry``, or
    empty."""
    numbered = [str(k) for k in joints_or(entry)]
    return listed(numbered) if numbered else ""


def parameter(name: str) -> str:
    """Name of a parameter in words: ``offset q2``, of crosstalk ``x.fz.ty`` ``ty into fz``."""
    shows, _, of = name.removeprefix("x.").partition(".")
    return f"{of} into {shows}" if name.startswith("x.") else name.translate(_SPACES)


def effect(name: str) -> Effect:
    """Load an `Effect` by its name."""
    known = registry.load("effects", name)
    assert isinstance(known, Effect)
    return known


def title(name: str) -> str:
    """Title of an effect by its name, beginning with a small letter."""
    return str(effect(name).title)


def capital(text: str) -> str:
    """The text with a capital first letter."""
    return text[:1].upper() + text[1:]
