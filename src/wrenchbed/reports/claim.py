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
class Size:
    """A parameter of a cause that is a quantity.

    Attributes:
        key: its name in diagnosis.json.
        name: the same in words.
        value: ± standard uncertainty with its unit.
        interval: of 95 %; a dash where it is not known.
    """

    key: str
    name: str
    value: str
    interval: str


@dataclass(frozen=True)
class Claim:
    """An entry of ``which`` in words: for the headline, cards and tables of every reader.

    Attributes:
        name: of the effect.
        title: what it is, with the joint's number where one joint has it; begins small.
        choices: which of its forms, in words: name in diagnosis.json and text of each.
        numbered: whether the title holds the joint's number.
        sizes: all quantities, in the order of diagnosis.json.
        figures: the best known of them.
        against: whether the figures are differences from what the metadata state.
        probability: that it is present.
        closed: share of the gap that it closes; a dash where it shows only between rows.
        rivals: name and title of the effects that this recording does not distinguish from it.
    """

    name: str
    title: str
    choices: tuple[tuple[str, str], ...]
    numbered: bool
    sizes: tuple[Size, ...]
    figures: tuple[Size, ...]
    against: bool
    probability: str
    closed: str
    rivals: tuple[tuple[str, str], ...]

    @property
    def choice(self) -> str:
        """Which of its forms, beyond what the title says; empty where it has one."""
        return ", ".join(t for n, t in self.choices if not (self.numbered and n == "joint"))

    @property
    def more(self) -> int:
        """How many parameters are not among the figures."""
        return len(self.sizes) - len(self.figures)

    @property
    def rows(self) -> tuple[Size, ...]:
        """Rows of a table of its parameters, at least one."""
        return self.sizes or (Size("–", "–", "–", "–"),)

    @property
    def sentence(self) -> str:
        """``Joint 2 is compliant and deflects under gravity: stiffness 9080 ± 950 N·m/rad.``"""
        words = [self.choice] if self.choice else []
        words += [f"{size.name} {size.value}" for size in self.figures]
        words += [f"{self.more} more"] if self.more else []
        values = f": {', '.join(words)}" if words else ""
        others = "".join(f"; or {title}" for _, title in self.rivals)
        return f"{capital(self.title)}{values}{others}."


def claim(entry: Mapping[str, Any]) -> Claim:
    """The claim of an entry of ``which`` of diagnosis.json."""
    name, any_joint = str(entry["effect"]), _or_joints(entry)
    values: Mapping[str, Any] = entry["parameters"]
    sizes = {
        n: Size(n, parameter(n), numbers.quantity(n, v, signed=name in STATED),
                numbers.interval(n, v))
        for n, v in values.items() if "unit" in v
    }  # fmt: skip
    total = entry.get("combination")
    if total is not None:
        sizes = {"sum": Size("sum", "together", numbers.quantity("sum", total),
                             numbers.interval("sum", total))}  # fmt: skip
    ranked = list(sizes)
    if len(ranked) > MOST_SIZES:
        ranked.sort(key=lambda n: _weight(values[n]))
    of_joint = str(effect(name).title_of_joint) if any_joint else ""
    closed = entry.get("closed_share")
    return Claim(
        name=name,
        title=of_joint.format(joint=any_joint) if of_joint else title(name),
        choices=tuple(
            (n, f"{parameter(n)} {numbers.quantity(n, v)}")
            for n, v in values.items() if "unit" not in v
        ),
        numbered=bool(of_joint),
        sizes=tuple(sizes.values()),
        figures=tuple(sizes[n] for n in ranked[:MOST_SIZES]),
        against=name in STATED,
        probability=numbers.chance(float(entry["probability"])),
        closed="–" if closed is None else f"{numbers.percent(float(closed))} %",
        rivals=tuple((str(r), title(str(r))) for r in entry["rivals"]),
    )  # fmt: skip


def place(entry: Mapping[str, Any]) -> str:
    """Where a claimed effect sits: ``joint 2``, ``joint 2, 3 or 4``, ``joints 3 and 5``, ``all
    joints``, ``sensor``."""
    part = str(entry["effect"]).split(".")[0]
    if any_joint := _or_joints(entry):
        return f"{part} {any_joint}"
    numbered = joints(entry) if part in ("joint", "link") else []
    if numbered:
        return f"{part}{'s' if len(numbered) > 1 else ''} {listed([str(k) for k in numbered])}"
    return f"all {part}s" if part in ("joint", "link") else part


def joints(entry: Mapping[str, Any]) -> list[int]:
    """Joints or links that a cause is about: those of which it names one, else whose amplitudes
    exceed three standard uncertainties."""
    if any_of := joints_or(entry):
        return any_of
    found = set()
    for name, told in entry["parameters"].items():
        match = _NUMBERED.search(name)
        size, std = told.get("value"), told.get("std")
        if match and std and abs(float(size)) > _STANDS_OUT * float(std):
            found.add(int(match[1]))
    return sorted(found)


def joints_or(entry: Mapping[str, Any]) -> list[int]:
    """Joints of which one is the cause, by their number; none where it is of no single joint."""
    joint = entry["parameters"].get("joint", {})
    value = joint.get("value")
    return sorted([value, *joint.get("rivals", [])]) if isinstance(value, int) else []


def _or_joints(entry: Mapping[str, Any]) -> str:
    """``2, 3 or 4``; empty where a cause is of no single joint."""
    numbered = [str(k) for k in joints_or(entry)]
    return listed(numbered, " or ") if numbered else ""


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


def _weight(parameter: Mapping[str, Any]) -> float:
    """By which the best known parameters come first."""
    value, std = float(parameter["value"]), parameter.get("std")
    return -abs(value) / float(std) if std else 0.0
