"""The verdict on a recording, and its options. Only `decide` makes or changes a verdict."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from wrenchbed.diagnosis.explain.finalist import Finalist

INSEPARABLE = tuple(frozenset({"mount.rotation", n}) for n in ("joint.offset", "sensor.crosstalk"))
"""Pairs of effects that no data without contact distinguishes."""

S = TypeVar("S")
Key = tuple[str, int | None]
"""Effect and joint (from 1) of a cause; None where the effect is of the whole robot."""


@dataclass(frozen=True)
class Part:
    """An effect, or a wrong stated number, that adds enough gap to be claimed.

    Attributes:
        name: name of the effect.
        share: gap that it adds, in noise variances of a row.
        probability: probability that a stated number is wrong; 1 for effects.
        index: index of the effect in its fitted set; None for a stated number.
        twins: names of effects that might as well be this one, whatever their evidence.
        imitators: names of effects that make its readings, perhaps with numbers that happen to fit.
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
        """Key of this part in held-out gaps and shares (`Closure.members`, `shares`): the effect's
        name, with the joint's number, from 1, if each joint is a cause: ``drive.coulomb 3``."""
        return self.name if self.joint is None else f"{self.name} {self.joint}"


@dataclass(frozen=True)
class Option(Generic[S]):
    """One set of causes, active at once, that may explain a recording.

    Attributes:
        explanation: the set of causes.
        probability: probability of the set; those of all options and of an unknown cause sum to 1.
        parts: parts that may be claimed from it, largest first.
    """

    explanation: S
    probability: float
    parts: tuple[Part, ...]

    @property
    def keys(self) -> frozenset[Key]:
        return frozenset(p.key for p in self.parts)


@dataclass(frozen=True)
class Elements:
    """Elements (joints, axes …) of an effect, one of which is the cause.

    Attributes:
        names: element of the explanation first, then the others, likeliest first.
        fits: fitted set of causes with each element in the cause's place.
        parts: index of each element's effect in that fitted set.
    """

    names: tuple[str, ...]
    fits: tuple[Finalist, ...]
    parts: tuple[int, ...]


@dataclass(frozen=True)
class Cause:
    """One claimed cause: a class of effects that the recording does not separate.

    Attributes:
        keys: the effect with its joint, then its rivals.
        probability: probability that one of the class is present.
        part: effect or stated number of the explanation that claims it.
        shares: share of each key in ``probability``, by how probable it makes the readings.
        elements: elements (joints …) that explain as well, by name of the effect.
    """

    keys: tuple[Key, ...]
    probability: float
    part: Part
    shares: tuple[float, ...] = ()
    elements: Mapping[str, Elements] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of the effect, then names of its rivals."""
        return tuple(dict.fromkeys(name for name, _ in self.keys))

    def fraction(self, name: str) -> float:
        """Share in ``probability`` of the effect ``name``, at all of its joints together."""
        shares = self.shares or (1.0 / len(self.keys),) * len(self.keys)
        return sum(s for key, s in zip(self.keys, shares, strict=True) if key[0] == name)

    @property
    def open_elements(self) -> tuple[str, ...]:
        """Elements of the first effect if the recording leaves several, else empty."""
        first = self.elements.get(self.names[0])
        return first.names if first is not None and len(first.names) > 1 else ()

    @property
    def plain(self) -> bool:
        """Whether the cause has no rival and no element that further data could separate."""
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
        causes: claimed causes, largest first; empty for none and unknown.
        explanation: set of causes behind the claims, also behind an unknown.
        probabilities: ``none``, ``unknown`` and each leading cause (names joined by ``|``): sum 1.
        alike: causes that explain the recording equally well and are too many for a claim.
    """

    word: str
    causes: tuple[Cause, ...]
    explanation: S
    probabilities: Mapping[str, float]
    alike: tuple[Key, ...] = ()
