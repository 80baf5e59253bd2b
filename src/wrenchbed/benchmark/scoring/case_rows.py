"""Rows of a benchmark: the truth of each case, and what each method answered."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from wrenchbed.benchmark.frame import EFFECTS
from wrenchbed.effects.chain import effects

OURS = "wrenchbed"
"""Name of the diagnosis among the methods."""


@dataclass(frozen=True)
class Claim:
    """Claim of a method about a recording.

    Attributes:
        verdict: ``none``, ``identified``, ``ambiguous``, ``partial`` or ``unknown``.
        causes: claimed classes, largest first, each its first choice and then its rivals.
        probabilities: over the leading answer; a class's key is its members joined by ``|``.
        presence: probability of each class to be there, where that is not its share as leading.
        set90: names that are said to hold the truth in 90 % of cases, none of who does not say.
    """

    verdict: str
    causes: tuple[tuple[str, ...], ...]
    probabilities: dict[str, float]
    presence: tuple[float, ...] = ()
    set90: tuple[str, ...] = ()

    @property
    def sure(self) -> float:
        """Stated probability of the first answer: its class, none or unknown."""
        if self.presence:
            return self.presence[0]
        first = "|".join(self.causes[0]) if self.causes else self.verdict
        return self.probabilities.get(first, 0.0)


@dataclass(frozen=True)
class Number:
    """A published parameter with its standard uncertainty, and the true one, SI."""

    name: str
    value: float
    std: float
    truth: float


def numbers(
    effect: str, published: Mapping[str, Mapping[str, Any]], true: Mapping[str, float]
) -> list[Number]:
    """Published parameters of an effect with an uncertainty, beside the true ones, 0 if unlisted.

    Only those that mean the same in the library and in the physics of the cases.

    Args:
        effect: its name.
        published: ``value`` and ``std`` by the parameter's name.
        true: SI.
    """
    pattern = EFFECTS[effect].compared if effect in EFFECTS else ""
    given = effects()[effect].amplitudes(published) if pattern else None
    return [
        Number(f"{effect}:{name}", float(p["value"]), float(p["std"]), true.get(name, 0.0))
        for name, p in (given or {}).items()
        if re.fullmatch(pattern, name) and p.get("std") is not None and math.isfinite(p["value"])
    ]


@dataclass(frozen=True)
class CaseRow:
    """Result row of one case.

    Attributes:
        id: of the case, unique in a benchmark.
        kind: ``none``, ``single``, ``pair`` or ``outside``.
        truth: the contract's names of the effects; empty for none and outside.
        outside: name of the family outside the library.
        size: what each cause adds to the gap; between rows, the mean rise of a row's variance.
        detectability: of each cause [σ]; norm of its signature over the noise of a row.
        between: causes that show between rows only.
        answers: claim of each method.
        where: first subsystem that the diagnosis names.
        numbers: parameters of the true effects as the diagnosis states them.
        closed, oracle: share of the held-out gap that the diagnosis closes, and what one closes
            that is told the effects.
        seconds: that each method took.
        error: what went wrong, empty if nothing did.
        alike: effects that this very data cannot tell from the true ones.
    """

    id: str
    kind: str
    truth: tuple[str, ...] = ()
    outside: str | None = None
    size: Mapping[str, float] = field(default_factory=dict)
    detectability: Mapping[str, float] = field(default_factory=dict)
    between: tuple[str, ...] = ()
    answers: Mapping[str, Claim] = field(default_factory=dict)
    where: str | None = None
    numbers: tuple[Number, ...] = ()
    closed: float | None = None
    oracle: float | None = None
    seconds: Mapping[str, float] = field(default_factory=dict)
    error: str = ""
    alike: tuple[str, ...] = ()
