"""What is said of a recording, and what it is chosen from. Only `decide` makes or changes it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from wrenchbed.diagnosis.explain.finalist import Finalist

NONE, UNKNOWN, PARTIAL = "none", "unknown", "partial"
INSEPARABLE = tuple(frozenset({"mount.rotation", n}) for n in ("joint.offset", "sensor.crosstalk"))
"""Pairs of effects that no data without contact distinguishes."""

S = TypeVar("S")
Key = tuple[str, int | None]
"""Effect and joint (from 1) of a cause; None where the effect is of the whole robot."""


@dataclass(frozen=True)
class Part:
    """An effect of a structure that adds enough to be claimed.

    Attributes:
        name: of the effect.
        share: gap that it adds.
        probability: that a stated number is wrong; 1 for other effects.
        index: its number in the structure, None for a wrong stated number.
        twins: effects that might as well be this one, whatever their evidence.
        imitators: effects that make its readings, if perhaps with numbers that happen to fit.
        joint: number of its joint, from 1, where each joint is a cause of its own.
    """

    name: str
    share: float
    probability: float = 1.0
    index: int | None = None
    twins: tuple[str, ...] = ()
    imitators: tuple[str, ...] = ()
    joint: int | None = None

    @property
    def key(self) -> Key:
        return self.name, self.joint

    @property
    def label(self) -> str:
        """Name by which held-out rows know it: with its joint where it has one."""
        return self.name if self.joint is None else f"{self.name} {self.joint}"


@dataclass(frozen=True)
class Option(Generic[S]):
    """One structure of causes that may explain a recording.

    Attributes:
        explanation: the structure.
        probability: of it; those of all options and of something unknown sum to 1.
        parts: what may be claimed from it, largest first.
    """

    explanation: S
    probability: float
    parts: tuple[Part, ...]

    @property
    def keys(self) -> frozenset[Key]:
        return frozenset(p.key for p in self.parts)


@dataclass(frozen=True)
class Elements:
    """Elements of an effect of which one is the cause.

    Attributes:
        names: that of the explanation first, then the likeliest.
        fits: a fit with each of them in the cause's place.
        parts: number of the part of that fit that is of the element.
    """

    names: tuple[str, ...]
    fits: tuple[Finalist, ...]
    parts: tuple[int, ...]


@dataclass(frozen=True)
class Cause:
    """One claimed cause: a class of effects that the recording does not tell apart.

    Attributes:
        keys: the effect with its joint, then those of its rivals.
        probability: that one of them is present.
        part: of the explanation that claims it.
        shares: of each in that probability, as far as evidence goes.
        elements: of each effect that were looked for, by its name.
    """

    keys: tuple[Key, ...]
    probability: float
    part: Part
    shares: tuple[float, ...] = ()
    elements: Mapping[str, Elements] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """The effect, then those of its rivals."""
        return tuple(dict.fromkeys(name for name, _ in self.keys))

    @property
    def open_elements(self) -> tuple[str, ...]:
        """Elements of the first effect where the recording leaves several."""
        first = self.elements.get(self.names[0])
        return first.names if first is not None and len(first.names) > 1 else ()

    @property
    def plain(self) -> bool:
        """Whether no other data would tell it from a rival, or it has none."""
        if self.open_elements or len(self.keys) > len(self.names):
            return False
        return any(
            all(other == name or frozenset({name, other}) in INSEPARABLE for other in self.names)
            for name in self.names
        )


@dataclass(frozen=True, eq=False)
class Verdict(Generic[S]):
    """What is said of a recording.

    Attributes:
        word: ``none``, ``identified``, ``ambiguous``, ``partial`` or ``unknown``.
        causes: claimed, largest first; empty for none and unknown.
        explanation: the structure that the claims are from, also behind an unknown.
        probabilities: of none, unknown and each class as the leading cause.
    """

    word: str
    causes: tuple[Cause, ...]
    explanation: S
    probabilities: Mapping[str, float]
