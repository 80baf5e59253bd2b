"""The linear problem that every baseline of a diagnosis starts from: noise and tolerances only.

No background of small imperfections and nothing unknown: what a careful user without them sees.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from wrenchbed.diagnosis.evidence.dictionary import EffectDictionary, Hypothesis, build
from wrenchbed.diagnosis.evidence.likelihood import LARGE, BackgroundLevel
from wrenchbed.diagnosis.evidence.search import NONE
from wrenchbed.diagnosis.explain.structures import Analysis, case
from wrenchbed.diagnosis.prepare.baseline import calibrate
from wrenchbed.diagnosis.prepare.configuration import STATED
from wrenchbed.diagnosis.prepare.prepared import Prepared

COUNTS = 1.0
"""A cause must add this gap (contract, "When a cause counts")."""
_RANK = 1e-10


@dataclass(frozen=True)
class Claim:
    """What a method says of a recording.

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


class LinearFit(NamedTuple):
    """A hypothesis fitted alone: coefficients (k,), fall of χ², and how many numbers it took."""

    hypothesis: Hypothesis
    x: np.ndarray
    gain: float
    freedom: int


@dataclass(frozen=True, eq=False)
class Linear:
    """Readings against the dictionary's columns, at the calibrated baseline.

    Attributes:
        d: the dictionary.
        y: readings (6 R,) against the baseline, stated numbers as stated, whitened.
        block: of each entry of ``y`` (6 R,).
    """

    d: EffectDictionary
    y: np.ndarray
    block: np.ndarray

    @cached_property
    def named(self) -> int:
        """The first so many columns are effects', the others the flexible unknown's."""
        return sum(bool(parameter) for _, parameter in self.d.label)

    def level(self, rows: np.ndarray | slice = slice(None)) -> BackgroundLevel:
        """Noise, and the stated numbers within their tolerances, of some rows."""
        variance = np.tile(self.d.prepared.variance, self.d.rows)[rows]
        allowed = np.minimum(self.d.tolerance**2, LARGE)
        return BackgroundLevel(self.d.E[rows][:, self.d.stated], variance, allowed)

    @cached_property
    def problem(self) -> tuple[np.ndarray, np.ndarray]:
        """P = EᵀK⁻¹E (n, n) and w = EᵀK⁻¹y (n,) of the effects' columns."""
        return self.normal(slice(None))

    def normal(self, rows: np.ndarray | slice) -> tuple[np.ndarray, np.ndarray]:
        """The same of some rows."""
        E = self.d.E[rows][:, : self.named]
        solved = self.level(rows).solve(E)
        P = E.T @ solved
        return (P + P.T) / 2, solved.T @ self.y[rows]

    @cached_property
    def singles(self) -> tuple[LinearFit, ...]:
        """Every hypothesis alone."""
        P, w = self.problem
        result = []
        for h in self.d.hypotheses:
            own = h.columns
            values, vectors = np.linalg.eigh(P[np.ix_(own, own)])
            kept = values > _RANK * max(float(values[-1]), 1e-300)
            turned = vectors[:, kept].T @ w[own]
            x = vectors[:, kept] @ (turned / values[kept])
            count = int(kept.sum()) + len(h.variant.shape)
            result.append(LinearFit(h, x, float(turned @ (turned / values[kept])), count))
        return tuple(result)

    @cached_property
    def residual(self) -> np.ndarray:
        """What a fit of bias, mass and CoG leaves (R, 6)."""
        basis = self.d.fitted_away
        return np.asarray(self.y - basis @ (basis.T @ self.y)).reshape(-1, 6)

    @property
    def noise(self) -> float:
        """Gap of noise alone."""
        return float(self.d.prepared.variance.mean())

    def added(self, name: str, columns: np.ndarray, x: np.ndarray) -> float:
        """Gap that columns of an effect add with coefficients (k,)."""
        return self.d.gap(self.d.E[:, columns] @ x, configured=name in STATED)


_made: "WeakKeyDictionary[Prepared, Linear]" = WeakKeyDictionary()


def linear(prepared: Prepared) -> Linear:
    """The linear problem of a recording, made once."""
    if prepared not in _made:
        baseline = calibrate(prepared)
        d = build(prepared, baseline.robot_theta, baseline.tolerance)
        _made[prepared] = Linear(d, case(d, prepared, baseline), np.repeat(prepared.block_rows, 6))
    return _made[prepared]


def reuse_dictionary(analysis: Analysis) -> None:
    """Let the baselines use the dictionary of an analysis instead of building it again."""
    p = analysis.prepared
    block = np.repeat(p.block_rows, 6)
    _made[p] = Linear(analysis.dictionary, analysis.refitter.y, block)


def nothing() -> Claim:
    """No cause, and sure of it."""
    return Claim(NONE, (), {NONE: 1.0})


def certain(names: Sequence[str]) -> Claim:
    """Causes by a method that knows no doubt; none if there are no names."""
    if not names:
        return nothing()
    return Claim("identified", tuple((n,) for n in names), {names[0]: 1.0})
