"""What a decision rests on, and what it comes to."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic

from wrenchbed.diagnosis.evidence.search import NONE
from wrenchbed.diagnosis.explain.verdict import Option, S, Verdict
from wrenchbed.diagnosis.gap.gaps import Closure


@dataclass(frozen=True, eq=False)
class Decision(Generic[S]):
    """A verdict with what it rests on.

    Attributes:
        verdict: final.
        gap: on held-out rows, with the causes of ``verdict``.
    """

    verdict: Verdict[S]
    gap: Closure

    @property
    def settled(self) -> bool:
        """Whether held-out rows uphold an answer that leaves no cause open."""
        return self.verdict.word in (NONE, "identified", "ambiguous")

    @property
    def rest(self) -> float:
        """Gap above the noise floor that the answer leaves on held-out rows."""
        return (self.gap.with_effects or self.gap.calibrated).value - max(self.gap.floor, 0.0)


@dataclass(frozen=True, eq=False)
class Facts(Generic[S]):
    """All that a decision rests on.

    Attributes:
        options: structures that may explain the recording, best first.
        unknown: probability of something that no effect of the library makes.
        measure: gaps on held-out rows with the causes of a verdict.
        right: fraction of such verdicts that are right.
        least: probability that every cause needs: more where few rows are left to tell causes
            apart.
        ordinary_fitted: whether the calibrated simulator has all stated values free within their
            ordinary spread, so that it may imitate causes.
        own_rest: whether what no effect explains counts as noise: without a cause it is unknown.
    """

    options: Sequence[Option[S]]
    unknown: float
    measure: Callable[[Verdict[S]], Closure]
    right: Callable[[Verdict[S], Closure], float]
    least: float = 0.0
    ordinary_fitted: bool = False
    own_rest: bool = False
