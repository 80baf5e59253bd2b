"""Truth of each case and claims about it: all that is scored; sealed files hold an `Answer`."""

import json
import math
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, NamedTuple

from wrenchbed.benchmark.fault import EFFECTS, subsystem
from wrenchbed.data.parquet import FORMAT
from wrenchbed.effects.chain import effects

OURS = "wrenchbed"
"""Name of the diagnosis among the methods."""


@dataclass(frozen=True)
class Fact:
    """A true cause of a case: name of the effect (or of a fault outside the library), size in
    multiples of the typical one, ``gap`` and ``rows`` as of `Shown`, its ``true`` numbers as a
    diagnosis publishes them, SI, minor imperfections included, and effects ``alike`` in these data.
    """

    effect: str
    size: float | None
    gap: float
    rows: float
    true: Mapping[str, float]
    alike: tuple[str, ...]

    @property
    def joint(self) -> str:
        """Joint of the cause as a diagnosis names it; empty where it is of none."""
        each = {n.rpartition(".q")[2]: abs(x) for n, x in self.true.items() if ".q" in n}
        number = self.true.get("joint", max(each, key=lambda n: each[n], default=None))
        return "" if number is None else f"joint {int(number)}"


@dataclass(frozen=True)
class Oracle:
    """Answer of an oracle that knows form and size of all possible causes: verdict, classes of
    effects that no data tell apart, and the share of the gap that the true effects remove."""

    verdict: str
    causes: tuple[tuple[str, ...], ...]
    closed: float | None


@dataclass(frozen=True)
class Answer:
    """Truth of a case of a kind (of `fault.KINDS`): ``minor`` is minor imperfections' gap, None of
    efforts; only the referee's have an oracle; random ``salt`` keeps hashes unguessable."""

    case: str
    robot: str
    mode: str
    kind: str
    causes: tuple[Fact, ...]
    minor: float | None
    rows: int
    oracle: Oracle | None
    salt: str
    format: int = FORMAT

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the library's effects that are causes of the case; empty for one outside."""
        return () if self.kind == "outside" else tuple(c.effect for c in self.causes)

    @property
    def alike(self) -> tuple[str, ...]:
        """Names of the true effects, and of those that these data cannot tell from them."""
        return (*self.effects, *(name for c in self.causes for name in c.alike))

    def to_bytes(self) -> bytes:
        """Bytes of the answer's file; the commitment is their SHA-256."""
        return (json.dumps(asdict(self), indent=1, ensure_ascii=False) + "\n").encode()


@dataclass(frozen=True)
class Claim:
    """Claim of a method about a recording; the verdict is ``error`` where there is no readable one.

    ``causes`` are classes of indistinguishable effects, largest first, each its first choice, then
    rivals; ``probabilities`` of each possible leading answer, a class's key its members joined by
    ``|``; ``presence`` of each class where that differs; ``set90`` names that hold the truth in 90
    % of cases; ``subsystem`` the first one named apart from causes; ``elements`` joints or parts by
    effect; ``parameters`` and ``gap`` finite numbers as published, by effect and name.
    """

    verdict: str = "error"
    causes: tuple[tuple[str, ...], ...] = ()
    probabilities: Mapping[str, float] = field(default_factory=dict)
    presence: tuple[float, ...] = ()
    set90: tuple[str, ...] = ()
    subsystem: str | None = None
    elements: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    parameters: Mapping[str, Mapping[str, Mapping[str, Any]]] = field(default_factory=dict)
    gap: Mapping[str, float] = field(default_factory=dict)
    seconds: float | None = None
    error: str = ""

    @property
    def sure(self) -> float:
        """Probability that the method states for its leading answer: a class, none or unknown."""
        if self.presence:
            return self.presence[0]
        first = "|".join(self.causes[0]) if self.causes else self.verdict
        return self.probabilities.get(first, 0.0)

    @property
    def where(self) -> str | None:
        """Name of the first subsystem that the method named; None if it named none."""
        return self.subsystem or (subsystem(self.causes[0][0]) if self.causes else None)


class CaseRow(NamedTuple):
    """The truth of a case, and the claims about it by name of method."""

    truth: Answer
    claims: Mapping[str, Claim]


class Number(NamedTuple):
    """A published parameter with its standard uncertainty, and the true one, SI."""

    name: str
    value: float
    std: float
    truth: float


def numbers(
    effect: str, published: Mapping[str, Mapping[str, Any]], true: Mapping[str, float]
) -> list[Number]:
    """Published parameters of an effect with an uncertainty, beside the true ones [SI], 0 if
    unlisted: those that mean the same in the library and in the physics of the cases."""
    pattern = EFFECTS[effect].compared if effect in EFFECTS else ""
    given = effects()[effect].amplitudes(published) if pattern else None
    return [
        Number(name, float(p["value"]), float(p["std"]), true.get(name, 0.0))
        for name, p in (given or {}).items()
        if re.fullmatch(pattern, name) and p.get("std") is not None and math.isfinite(p["value"])
    ]
