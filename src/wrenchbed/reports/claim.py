"""A claimed cause as every reader meets it: one sentence for page, terminal and rerun."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from wrenchbed import registry
from wrenchbed.diagnosis.prepare.configuration import STATED
from wrenchbed.effects.base import Effect
from wrenchbed.pages import numbers

MOST_SIZES = 3
"""Parameters of a cause in its sentence and on the first screen."""
_STANDS_OUT = 3.0
"""Standard uncertainties beyond which a joint's amplitude is one."""
_NUMBERED = re.compile(r"\.[a-z]*(\d+)$")
"""Names as ``offset.q3`` and ``twist.2``."""


@dataclass(frozen=True)
class Claim:
    """An entry of ``which`` in words.

    Attributes:
        name: of the effect.
        title: what it is, with the joint's number where one joint has it; begins small.
        choice: which of its forms, in words; empty where it has one.
        figures: name and value ± standard uncertainty of the best known parameters.
        more: further parameters.
        against: whether the figures are differences from what the metadata state.
        probability: that it is present.
        rivals: name and title of the effects that this recording does not distinguish from it.
    """

    name: str
    title: str
    choice: str
    figures: tuple[tuple[str, str], ...]
    more: int
    against: bool
    probability: str
    rivals: tuple[tuple[str, str], ...]

    @property
    def sentence(self) -> str:
        """``Joint 2 is compliant and deflects under gravity: stiffness 9080 ± 950 N·m/rad.``"""
        told = [self.choice] if self.choice else []
        told += [f"{name} {value}" for name, value in self.figures]
        told += [f"{self.more} more"] if self.more else []
        values = f": {', '.join(told)}" if told else ""
        others = "".join(f"; or {title}" for _, title in self.rivals)
        return f"{capital(self.title)}{values}{others}."


def claim(entry: Mapping[str, Any]) -> Claim:
    """The claim of an entry of ``which`` of diagnosis.json."""
    name, joint = str(entry["effect"]), one_joint(entry)
    choices, sizes = parts(entry)
    ranked = sizes if len(sizes) <= MOST_SIZES else sorted(sizes, key=_weight)
    shown = ranked[:MOST_SIZES]
    own = str(effect(name).title_of_joint) if joint is not None else ""
    return Claim(
        name=name,
        title=own.format(joint=joint) if own else title(name),
        choice=", ".join(text for n, text in choices if not (own and n == "joint")),
        figures=tuple(
            (parameter(n), numbers.quantity(n, v, signed=name in STATED)) for n, v in shown
        ),
        more=len(sizes) - len(shown),
        against=name in STATED,
        probability=numbers.chance(float(entry["probability"])),
        rivals=tuple((str(r), title(str(r))) for r in entry["rivals"]),
    )


Choice = tuple[str, str]
Size = tuple[str, Mapping[str, Any]]


def parts(entry: Mapping[str, Any]) -> tuple[list[Choice], list[Size]]:
    """What of a cause's parameters is a choice, with its words, and what is a quantity."""
    own: Mapping[str, Any] = entry["parameters"]
    choices = [
        (n, f"{parameter(n)} {numbers.quantity(n, v)}") for n, v in own.items() if "unit" not in v
    ]
    return choices, [(n, v) for n, v in own.items() if "unit" in v]


def place(entry: Mapping[str, Any]) -> str:
    """Where a claimed effect sits: ``joint 2``, ``joints 3 and 5``, ``all joints``, ``sensor``."""
    part = str(entry["effect"]).split(".")[0]
    own = joints(entry) if part in ("joint", "link") else []
    if own:
        return f"{part}{'s' if len(own) > 1 else ''} {listed([str(k) for k in own])}"
    return f"all {part}s" if part in ("joint", "link") else part


def joints(entry: Mapping[str, Any]) -> list[int]:
    """Joints or links that a cause is about: the one that it names, else whose amplitudes exceed
    three standard uncertainties."""
    joint = one_joint(entry)
    if joint is not None:
        return [joint]
    found = set()
    for name, told in entry["parameters"].items():
        match = _NUMBERED.search(name)
        size, std = told.get("value"), told.get("std")
        if match and std and abs(float(size)) > _STANDS_OUT * float(std):
            found.add(int(match[1]))
    return sorted(found)


def one_joint(entry: Mapping[str, Any]) -> int | None:
    """The joint that a cause names as its only one."""
    joint = entry["parameters"].get("joint", {}).get("value")
    return joint if isinstance(joint, int) else None


def parameter(name: str) -> str:
    """``offset.q2`` → ``offset q2``."""
    return name.replace(".", " ").replace("_", " ")


def effect(name: str) -> Effect:
    """The effect of a name."""
    known = registry.load("effects", name)
    assert isinstance(known, Effect)
    return known


def title(name: str) -> str:
    """What an effect is, in words that begin small."""
    return str(effect(name).title)


def capital(text: str) -> str:
    """With a capital first letter."""
    return text[:1].upper() + text[1:]


def listed(told: Sequence[str], last: str = " and ") -> str:
    """``a, b and c``."""
    return last.join([x for x in (", ".join(told[:-1]), told[-1]) if x])


def _weight(item: Size) -> float:
    """The best known parameters first."""
    value, std = float(item[1]["value"]), item[1].get("std")
    return -abs(value) / float(std) if std else 0.0
