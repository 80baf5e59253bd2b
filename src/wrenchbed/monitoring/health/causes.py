"""Why the readings changed: every effect of the library as the explanation of the difference.

The difference D of the mean readings after and before the change is one vector over poses and
channels. An effect explains it with the evidence of D ~ N(0, C + s² A diag(σ²) A'): A are its
tangents, σ its typical sizes, s a few factors, C the noise and the learnt scatter from check to
check. Unknown is any pattern at all. So probabilities follow from data that no fit has tuned, and
effects that look alike in these poses share them. The linear form of an effect is exact, or misses
the share of its own gap that it states (`Effect.form_error`): both are equally likely before.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from wrenchbed.effects.base import Effect, Variant
from wrenchbed.effects.chain import effects
from wrenchbed.monitoring.health.quantities import Basis
from wrenchbed.monitoring.health.trends import Trends
from wrenchbed.pages.numbers import quantity

SIZES = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
"""Sizes of an effect in multiples of typical, equally likely; estimates."""
NAMED = 0.9
"""Probability that the named causes hold together."""
MOST_NAMED = 4
"""More causes than these are no answer."""
_FORM = 0.03
"""Share of a change that the linear form of an effect may miss; estimate, of changes up to 1°."""
_PRIOR_UNKNOWN = 1.0
"""Prior weight of no effect of the library, an effect has 1; estimate."""


@dataclass(frozen=True)
class Cause:
    """An effect that explains a change.

    Attributes:
        effect: its name.
        probability: among all effects, and none of them.
        label: of its best variant.
        parameters: {name: {value, std, unit}} of the change, as a diagnosis states them.
    """

    effect: str
    probability: float
    label: str
    parameters: Mapping[str, Mapping[str, Any]]

    @property
    def sizes(self) -> str:
        """All parameters for people."""
        return ", ".join(f"{n} {quantity(n, v, signed=True)}" for n, v in self.parameters.items())


@dataclass(frozen=True, eq=False)
class Difference:
    """Change of the mean readings by a step.

    Attributes:
        value: whitened (6 P,).
        covariance: of its noise and ordinary scatter (6 P, 6 P).
    """

    value: np.ndarray
    covariance: np.ndarray

    @classmethod
    def of(cls, trends: Trends, begin: int) -> "Difference":
        """Of the checks from ``begin`` on against those of the same stretch before."""
        basis, since = trends.basis, trends.since
        tangents = basis.whiten(np.moveaxis(basis.reference.tangents, -1, 0))
        rows = basis.whiten(basis.residual) - trends.known(begin) @ tangents
        value = rows[begin:].mean(axis=0) - rows[since:begin].mean(axis=0)
        share = 1.0 / (trends.n - begin) + 1.0 / (begin - since)
        own = np.diagonal(basis.covariance)
        more = np.maximum(trends.scatters(begin) ** 2 - own, 0.0)
        warming = basis.whiten(np.moveaxis(basis.warming, -1, 0))
        scatter = (tangents.T * more) @ tangents + (warming.T * basis.warm_std**2) @ warming
        rest = max(trends.rest(begin), 1.0)
        return cls(value, share * (scatter + rest * np.eye(len(value))))

    def seen(self, form: float) -> "Seen":
        """It as unit noise, where a form misses a share of the change's square."""
        n = len(self.value)
        missed = form * float(self.value @ self.value) / n
        root = np.linalg.cholesky(self.covariance + missed * np.eye(n))
        turn = np.linalg.inv(root)
        return Seen(turn, turn @ self.value, float(np.log(np.diagonal(root)).sum()))


class Seen(NamedTuple):
    """A difference turned to unit noise: the turn (N, N), the difference (N,), log det of the root
    of its covariance."""

    turn: np.ndarray
    d: np.ndarray
    volume: float

    def evidence(self, columns: np.ndarray) -> float:
        """Logarithm of the likelihood with columns (N, k) of typical size, mean over `SIZES`."""
        u, s, _ = np.linalg.svd(self.turn @ columns, full_matrices=False)
        part = (u.T @ self.d) ** 2
        variance = np.square(np.array(SIZES)[:, None] * s)
        logs = 0.5 * (part * variance / (1.0 + variance) - np.log1p(variance)).sum(axis=1)
        alone = -0.5 * float(self.d @ self.d) - self.volume
        return alone + float(np.logaddexp.reduce(logs) - np.log(len(SIZES)))


def explain(trends: Trends, begin: int) -> tuple[list[Cause], float]:
    """Causes of a change, the likeliest first, and the probability that it is none of them."""
    basis = trends.basis
    difference = Difference.of(trends, begin)
    exact = difference.seen(_FORM**2)
    found: dict[str, tuple[float, Variant, np.ndarray]] = {}
    for effect, variants in _candidates(basis):
        own = effect.parameters(basis.robot)
        slopes = {}
        for name in dict.fromkeys(p for v in variants for p in v.free):
            variant = next(v for v in variants if name in v.free)
            tangent = basis.reference.response.tangent(effect, own[own.index(name)], variant)
            slopes[name] = basis.whiten(tangent)
        weights = np.array([v.weight for v in variants])
        columns = [np.stack([slopes[p] for p in v.free], axis=1) for v in variants]
        forms = (exact, difference.seen(effect.form_error))
        scores = np.array([[f.evidence(c) for c in columns] for f in forms])
        scores += np.log(weights / weights.sum()) - np.log(len(forms))
        best = int(np.argmax(np.logaddexp.reduce(scores, axis=0)))
        total = float(np.logaddexp.reduce(scores, axis=None))
        found[effect.name] = (total, variants[best], exact.turn @ columns[best])
    none = exact.evidence(basis.any_pattern) + float(np.log(_PRIOR_UNKNOWN))
    logs = np.array([none, *(score for score, _, _ in found.values())])
    p = np.exp(logs - np.logaddexp.reduce(logs))
    causes = [
        Cause(name, float(chance), variant.label, _sizes(basis, name, variant, columns, exact.d))
        for chance, (name, (_, variant, columns)) in zip(p[1:], found.items(), strict=True)
    ]
    return sorted(causes, key=lambda c: -c.probability), float(p[0])


def named(causes: list[Cause], unknown: float) -> list[Cause]:
    """The causes that hold `NAMED` together; none where that is not so, or they are too many."""
    total = 0.0
    chosen: list[Cause] = []
    for cause in causes:
        if total >= NAMED * (1.0 - unknown) or len(chosen) > MOST_NAMED:
            break
        chosen.append(cause)
        total += cause.probability
    return chosen if unknown < 0.5 and len(chosen) <= MOST_NAMED else []


def _candidates(basis: Basis) -> Iterator[tuple[Effect, list[Variant]]]:
    """Effects with their variants that a change from one month to the next may be.

    Those that act by jumps have no tangent; those of one day, a check's own scatter holds.
    """
    for effect in effects().values():
        if (
            effect.between_rows
            or effect.rough
            or effect.once
            or not effect.acts(basis.reference.scene)
        ):
            continue
        variants = [v for v in effect.variants(basis.reference.scene) if not v.shape]
        if variants:
            yield effect, variants


def _sizes(
    basis: Basis, name: str, variant: Variant, columns: np.ndarray, d: np.ndarray
) -> dict[str, dict[str, Any]]:
    """Values of an effect's amplitudes as a diagnosis publishes them."""
    effect = effects()[name]
    own = effect.parameters(basis.robot)
    typical = np.array([own[own.index(p)].tolerance for p in variant.free])
    inverse = np.linalg.inv(columns.T @ columns + np.eye(len(typical)) / SIZES[-1] ** 2)
    size = typical * (inverse @ (columns.T @ d))
    std = typical * np.sqrt(np.diagonal(inverse))
    values = {p.name: p.nominal for p in own} | dict(variant.at)
    values |= dict(zip(variant.free, size.tolist(), strict=True))
    return effect.publish(
        basis.robot, variant, values, dict(zip(variant.free, std.tolist(), strict=True))
    )
