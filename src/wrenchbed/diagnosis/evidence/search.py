"""Evidence of every hypothesis, alone or beside others, in the linear model: for wrenches on every
background level ("rung") and size, for joint efforts on one of each."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from wrenchbed.diagnosis.evidence.dictionary import EffectDictionary, Hypothesis
from wrenchbed.diagnosis.evidence.likelihood import (
    BackgroundLevel,
    OfProducts,
    gains,
    ladder,
    log_sum,
    squares,
)

NONE, UNKNOWN, PARTIAL = "none", "unknown", "partial"
PRIOR = {NONE: 0.35, "one": 0.45, UNKNOWN: 0.15}
MORE = 0.1
"""Prior odds of each further effect beside a first one."""
STEPS = 7
"""Number of sizes tried of an effect, each twice the one before, from a gap of 1 upwards."""
LEAST_SCALE, LARGEST_SCALE = 0.06, 8.0
KERNEL_SCALES = 2.0 ** np.arange(0, 9, 1.0)
"""Prior standard deviations of a group of smooth functions; their squares are gaps."""


@dataclass(frozen=True)
class SingleEvidence:
    """Posterior of one hypothesis alone on one level of background (small errors of all kinds).

    Attributes:
        index: `Batch.index` of the hypothesis; −1 − k for smooth function k.
        rung: index of the level of background in `Candidates.levels`.
        log_posterior: natural logarithm of prior times evidence (probability of the readings with
            all sizes integrated out), not normalised.
    """

    index: int
    rung: int
    log_posterior: float


def best_variants(
    hypotheses: Sequence[Hypothesis], singles: Iterable[SingleEvidence]
) -> dict[str, SingleEvidence]:
    """Best variant of each effect by name, likeliest effect first; smooth functions left out."""
    best: dict[str, SingleEvidence] = {}
    for s in sorted(singles, key=lambda s: -s.log_posterior):
        if s.index >= 0:
            best.setdefault(hypotheses[s.index].name, s)
    return best


@dataclass(frozen=True, eq=False)
class Batch:
    """Hypotheses with the same number of columns, evaluated together."""

    index: np.ndarray  # (b,) places among all
    columns: np.ndarray  # (b, k)
    size: np.ndarray  # (b, k) relative prior standard deviations that they add
    scales: np.ndarray  # (b, s) factors on these
    prior: np.ndarray  # (b,) log


class Candidates:
    """Evidence (probability of the readings, sizes integrated out) of hypotheses beside a set of
    causes; a hypothesis widens the prior of its columns.

    Attributes:
        batches: the hypotheses.
        levels: levels of background (small errors of all kinds).
    """

    batches: Sequence[Batch]
    levels: Sequence[OfProducts]

    def __init__(self) -> None:
        self._informations: dict[int, list[np.ndarray]] = {}

    def added(
        self, rung: int, base: float, score: np.ndarray, known: np.ndarray | None = None
    ) -> list[SingleEvidence]:
        """Log posterior of a set of causes with each further effect variant or smooth function, on
        the background level of index ``rung``; ``base`` is that of the set alone.

        ``score`` has the derivatives w of the log likelihood by all columns (n,), beside these
        causes; with ``known`` H (m, n), HᵀH is the information that they take up.
        """
        result: list[SingleEvidence] = []
        for batch, alone in zip(self.batches, self._information(rung), strict=True):
            blocks = alone if known is None else alone - squares(known, batch.columns)
            w = score[batch.columns][:, :, None]
            gain = gains(blocks, w, batch.size, batch.scales)[:, :, 0]
            total = log_sum(gain) - np.log(gain.shape[1]) + batch.prior + base
            result += [
                SingleEvidence(int(k), rung, float(v))
                for k, v in zip(batch.index, total, strict=True)
            ]
        return result

    def _information(self, rung: int) -> list[np.ndarray]:
        """Information (b, k, k) of each batch on the background level of index ``rung``."""
        if rung not in self._informations:
            every = (batch.columns for batch in self.batches)
            self._informations[rung] = self.levels[rung].informations(every)
        return self._informations[rung]


def batches(each: Iterable[tuple[int, np.ndarray, np.ndarray, np.ndarray, float]]) -> list[Batch]:
    """Hypotheses grouped by number of columns; each: index, columns, size, scales, log prior."""
    groups: dict[int, list[Any]] = {}
    for hypothesis in each:
        groups.setdefault(len(hypothesis[1]), []).append(hypothesis)
    return [Batch(*map(np.array, zip(*some, strict=True))) for some in groups.values()]


class Searcher(Candidates):
    """Evidence of hypotheses (probability of readings, sizes integrated out) for one design: poses,
    noise and stated numbers; made once of its dictionary."""

    def __init__(self, dictionary: EffectDictionary) -> None:
        super().__init__()
        self.d = dictionary
        self.hypotheses: tuple[Hypothesis, ...] = dictionary.hypotheses
        self.kernels = tuple(dictionary.kernels)
        self._last: tuple[np.ndarray, tuple[list[np.ndarray], np.ndarray]] | None = None

    @cached_property
    def levels(self) -> tuple[BackgroundLevel, ...]:  # type: ignore[override]
        """Levels of background, smallest gap first; made on first use."""
        return ladder(self.d)

    @cached_property
    def batches(self) -> tuple[Batch, ...]:  # type: ignore[override]
        """Effect variants, and smooth functions of unknown causes, grouped by number of columns."""
        every = enumerate(self.hypotheses)
        result = batches(
            (k, h.columns, np.ones(len(h.columns)), self.scales(h), self.prior(h)) for k, h in every
        )
        log_prior = np.log(PRIOR[UNKNOWN] / max(1, len(self.kernels)))
        for k, columns in enumerate(self.d.kernels.values()):
            one = -1 - k, columns, np.ones(len(columns)), KERNEL_SCALES, log_prior
            result += batches([one])
        return tuple(result)

    def scales(self, h: Hypothesis) -> np.ndarray:
        """Prior standard deviations (s,) of a hypothesis's amplitudes, in typical sizes."""
        least = max(LEAST_SCALE, 1.0 / np.sqrt(max(h.typical_gap, 1e-12)))
        return np.asarray(np.minimum(least * 2.0 ** np.arange(STEPS), max(LARGEST_SCALE, least)))

    def prior(self, h: Hypothesis) -> float:
        """Log prior of a hypothesis alone.

        Every effect has the same prior, divided among its variants by their weights; a hypothesis
        that shows only beyond its typical size has a smaller one.
        """
        rare = min(1.0, float(np.sqrt(h.typical_gap)) * 2.0)
        fraction = h.variant.weight / self._weights[h.name]
        return float(np.log(PRIOR["one"] / len(self._weights) * fraction * rare))

    @property
    def names(self) -> Collection[str]:
        """Names of the effects of all hypotheses."""
        return self._weights.keys()

    @cached_property
    def _weights(self) -> dict[str, float]:
        """Total prior weight of each effect's variants."""
        total: dict[str, float] = {}
        for h in self.hypotheses:
            total[h.name] = total.get(h.name, 0.0) + h.variant.weight
        return total

    def nulls(self, y: np.ndarray) -> np.ndarray:
        """Log evidence (L,) of y (C R,) without a cause, by background level, prior included."""
        return self._scored(y)[1]

    def _scored(self, y: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
        """Scores w (n,) of y (C R,) by background level, and `nulls`; cached for the last y."""
        if self._last is None or self._last[0] is not y:
            both = [r.scored(y[:, None]) for r in self.levels]
            null = np.array([float(n[0]) for _, n in both]) + self.rung_prior(y)
            self._last = y, ([w[:, 0] for w, _ in both], null)
        return self._last[1]

    def singles(self, y: np.ndarray) -> list[SingleEvidence]:
        """Posterior of every variant or smooth function alone by background level, for y (C R,)."""
        result: list[SingleEvidence] = []
        scores, nulls = self._scored(y)
        for r, (base, score) in enumerate(zip(nulls, scores, strict=True)):
            result += self.added(r, float(base), score)
        return result

    def remainders(
        self, rung: int, energy: float, score: np.ndarray, known: np.ndarray
    ) -> np.ndarray:
        """Least cost (H,) of a signal fitted by each of H hypotheses: square of the rest over
        background and noise, plus the square of its sizes over their largest scales.

        ``energy`` is the square of the whole signal over background and noise, ``score`` (n,) that
        of all columns for the signal as readings; ``rung`` and ``known`` are as in `added`.
        """
        result = np.full(len(self.hypotheses), np.inf)
        for batch, alone in zip(self.batches, self._information(rung), strict=True):
            if batch.index[0] < 0:
                continue
            precision = np.eye(batch.columns.shape[1]) / batch.scales[:, -1, None, None] ** 2
            w = score[batch.columns]
            x = np.linalg.solve(alone - squares(known, batch.columns) + precision, w[:, :, None])
            result[batch.index] = energy - (w * x[:, :, 0]).sum(axis=1)
        return result

    def rung_prior(self, y: np.ndarray) -> np.ndarray:
        """Log prior of each background level (L,): equal for those of healthy robots; larger ones
        are likely only if the wrench's gap in the readings y is much larger than theirs."""
        total = max(float(self.d.gaps(y)[0]), 0.0)
        gaps = np.array([r.gap for r in self.levels])
        normal = np.array([r.normal for r in self.levels])
        prior = np.where(normal, 1.0 / normal.sum(), 0.1)
        return np.log(np.where(~normal & (gaps > 0.02 * total), 1e-4 * prior, prior))
