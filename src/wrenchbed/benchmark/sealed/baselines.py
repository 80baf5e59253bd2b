"""Baselines: usual ways to name a cause, which a benchmark of the diagnosis prints beside it.

All start from the same calibrated simulator and dictionary of effects as the diagnosis, with noise
and tolerances only: no small imperfections, no refit, no answer for what no effect makes. Methods
that know no doubt by themselves get a probability by stability: how often they claim the same of
half of the rows (Meinshausen & Bühlmann 2010, 10.1111/j.1467-9868.2010.00740.x).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.distance import cdist
from scipy.special import logsumexp, softmax

from wrenchbed.benchmark.scoring.truth_and_claims import Claim
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.evidence.dictionary import (
    LARGEST,
    EffectDictionary,
    Hypothesis,
    build,
    variables,
)
from wrenchbed.diagnosis.evidence.likelihood import LARGE
from wrenchbed.diagnosis.evidence.search import NONE, UNKNOWN
from wrenchbed.diagnosis.explain.structures import readings_from_baseline
from wrenchbed.diagnosis.prepare.bias_and_load_fit import calibrate
from wrenchbed.diagnosis.prepare.configured_simulator import STATED
from wrenchbed.diagnosis.prepare.prepare_recording import prepare

COUNTS = 1.0
"""Gap from which an effect is a cause (docs/contracts.md)."""
SIGMAS = 3.0
"""Standard uncertainties from which a number of a fit of all effects counts as there."""
HALVES, FOLDS = 20, 5
"""Halves of the rows whose claims are counted, and folds of the cross-validation."""
PENALTIES = np.geomspace(1.0, 1e-3, 25)
"""Penalties of the LASSO, over the least that lets no effect in."""
_STEPS = 100
"""Gradient steps at each penalty; three times as many changed one claim of eight in motion, at a
probability of 0.4."""
_LENGTHS, _SIZES = (0.3, 1.0, 3.0), np.geomspace(0.01, 1e4, 13)
"""Length scales of a Gaussian process, over the median distance of its inputs, and its prior
variances, over the noise's: decades about all that recordings show."""
_RANK = 1e-10
"""Least eigenvalue that counts, relative to the largest one."""
Pick = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Amplitudes (k,) from the Gram matrix (k, k) of the columns and their products (k,) with y."""


@dataclass(frozen=True, eq=False)
class Linear:
    """Readings y (m,) beside the columns (m, k) of all effects, in units of noise, less their fit
    by bias, mass and CoG within the stated tolerances; ``row`` (m,): the observation of each;
    ``at`` (k,): indices of the columns in the dictionary."""

    d: EffectDictionary
    at: np.ndarray
    columns: np.ndarray
    y: np.ndarray
    row: np.ndarray

    @classmethod
    def of(cls, recording: Recording) -> "Linear":
        """Linearise a recording of a wrench at its calibrated simulator."""
        prepared = prepare(recording).leading.coarse
        baseline = calibrate(prepared)
        d = build(prepared, baseline.robot_theta, baseline.tolerance)
        named = sum(bool(parameter) for _, parameter in d.label)
        both = np.column_stack([d.E[:, :named], readings_from_baseline(d, prepared, baseline)])
        noise = np.sqrt(np.tile(prepared.variance, d.rows))[:, None]
        tolerance = np.diag(1.0 / np.minimum(d.tolerance, np.sqrt(LARGE)))
        basis = np.linalg.qr(np.vstack([d.E[:, d.stated] / noise, tolerance]))[0]
        both = np.vstack([both / noise, np.zeros((len(tolerance), named + 1))])
        both = both - basis @ (basis.T @ both)
        row = np.append(np.repeat(np.arange(d.rows), d.channels), np.full(len(tolerance), -1))
        return cls(d, np.arange(named), both[:, :-1], both[:, -1], row)

    def products(self, rows: np.ndarray | slice = slice(None)) -> tuple[np.ndarray, np.ndarray]:
        """Gram matrix (k, k) and products with y (k,), over all rows or a mask ``rows`` (m,)."""
        some = self.columns[rows]
        return some.T @ some, some.T @ self.y[rows]

    def counting(self, x: np.ndarray) -> list[str]:
        """Effects whose amplitudes x (k,) add a gap of `COUNTS`, largest first."""
        d, gaps = self.d, dict[str, float]()
        owner = np.array([d.label[k][0] for k in self.at])
        for name in dict.fromkeys(owner[x != 0.0].tolist()):
            of_it = owner == name
            signal = d.E[:, self.at[of_it]] @ x[of_it]
            gaps[name] = d.gap(signal, configured=name in STATED)
        return sorted((n for n, gap in gaps.items() if gap >= COUNTS), key=lambda n: -gaps[n])

    def alone(self) -> dict[str, tuple[Hypothesis, float]]:
        """Variant of each effect, by name, of least BIC, and −½ BIC against no effect."""
        gram, score = self.products()
        penalty = float(np.log(np.sum(self.row >= 0)))
        result = dict[str, tuple[Hypothesis, float]]()
        for h in self.d.hypotheses:
            values, vectors = np.linalg.eigh(gram[np.ix_(h.columns, h.columns)])
            kept = values > _RANK * max(float(values[-1]), 1e-300)
            fall = float(((vectors[:, kept].T @ score[h.columns]) ** 2 / values[kept]).sum())
            log = 0.5 * (fall - (int(kept.sum()) + len(h.variant.shape)) * penalty)
            if h.name not in result or log > result[h.name][1]:
                result[h.name] = h, log
        return result

    def best(self) -> "Linear":
        """The same with each effect in the variant that is best alone."""
        at = np.unique(np.concatenate([h.columns for h, _ in self.alone().values()]))
        return replace(self, at=at, columns=self.columns[:, at])

    def claim(self, pick: Pick) -> Claim:
        """Claim of what ``pick`` finds in all rows, as probable as its leading effect is in halves
        of them."""
        leads, rng = dict[str, float](), np.random.default_rng(0)
        for _ in range(HALVES):
            half = rng.permutation(self.d.rows) < self.d.rows // 2
            first = (*self.counting(pick(*self.products((self.row < 0) | half[self.row]))), NONE)[0]
            leads[first] = leads.get(first, 0.0) + 1.0 / (HALVES + 1)
        causes = self.counting(pick(*self.products()))
        lead = causes[0] if causes else NONE
        leads[lead] = leads.get(lead, 0.0) + 1.0 / (HALVES + 1)
        return Claim("identified" if causes else NONE, tuple((n,) for n in causes), leads)


def none(recording: Recording) -> Claim:
    """Baseline that claims for every recording that there is no cause."""
    return Claim(NONE, (), {NONE: 1.0})


def bic(recording: Recording) -> Claim:
    """Baseline: the single effect, or none, of least BIC, with probabilities ∝ exp(−ΔBIC/2)."""
    logs = {NONE: 0.0} | {h.name: log for h, log in Linear.of(recording).alone().values()}
    total = logsumexp(list(logs.values()))
    probabilities = {k: float(np.exp(v - total)) for k, v in logs.items()}
    best = max(probabilities, key=lambda k: probabilities[k])
    causes = () if best == NONE else ((best,),)
    return Claim("identified" if causes else NONE, causes, probabilities)


def everything(recording: Recording) -> Claim:
    """Baseline: a ridge fit of all effects at once, each in the variant that is best alone, numbers
    at most `LARGEST` times typical; claims those with one beyond `SIGMAS` that add a gap."""

    def pick(gram: np.ndarray, score: np.ndarray) -> np.ndarray:
        covariance = np.linalg.inv(gram + np.eye(len(gram)) / LARGEST**2)
        x = covariance @ score
        return np.where(np.abs(x) > SIGMAS * np.sqrt(np.diagonal(covariance)), x, 0.0)

    return Linear.of(recording).best().claim(pick)


def lasso(recording: Recording) -> Claim:
    """Baseline: LASSO over all effects, each in the variant that is best alone, its penalty by
    cross-validation."""
    linear = Linear.of(recording).best()
    fold = np.random.default_rng(0).permutation(linear.d.rows)[linear.row] % FOLDS
    errors = np.zeros(len(PENALTIES))
    for k in range(FOLDS):
        used, left = (linear.row < 0) | (fold != k), (linear.row >= 0) & (fold == k)
        for at, x in enumerate(lasso_path(*linear.products(used), PENALTIES)):
            errors[at] += np.sum((linear.y[left] - linear.columns[left] @ x) ** 2)
    penalties = PENALTIES[: int(errors.argmin()) + 1]
    return linear.claim(lambda gram, score: lasso_path(gram, score, penalties)[-1])


def lasso_path(gram: np.ndarray, score: np.ndarray, penalties: np.ndarray) -> list[np.ndarray]:
    """LASSO's amplitudes (k,) of columns of unit norm at each of the ``penalties``, over that which
    lets nothing in, by FISTA (Beck & Teboulle 2009, 10.1137/080716542)."""
    size = np.sqrt(np.maximum(np.diagonal(gram), 1e-12))
    gram, score = gram / np.outer(size, size), score / size
    step = 1.0 / float(np.linalg.eigvalsh(gram)[-1])
    x, result = np.zeros(len(score)), list[np.ndarray]()
    for penalty in np.abs(score).max() * penalties:
        ahead, t = x, 1.0
        for _ in range(_STEPS):
            moved = ahead + step * (score - gram @ ahead)
            new = np.sign(moved) * np.maximum(np.abs(moved) - step * penalty, 0.0)
            further = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * t * t))
            ahead, x, t = new + (t - 1.0) / further * (new - x), new, further
        result.append(x / size)
    return result


def black_box(recording: Recording) -> Claim:
    """Baseline: a Gaussian process of pose, time and speed (Rasmussen & Williams 2006, equations
    2.25 and 2.30), which names no effect: unknown where its mean adds a gap, else none."""
    linear = Linear.of(recording)
    d, some = linear.d, linear.row >= 0
    inputs = d.prepared.averages(np.column_stack([*variables(d.prepared).values()]))
    inputs = (inputs - inputs.mean(axis=0)) / np.maximum(inputs.std(axis=0), 1e-9)
    far, y = cdist(inputs, inputs, "sqeuclidean"), linear.y[some].reshape(d.rows, -1)
    logs, counts = list[float](), list[bool]()
    for length in _LENGTHS:
        values, vectors = np.linalg.eigh(np.exp(-0.5 * far / (length**2 * np.median(far))))
        across = vectors.T @ y
        for size in _SIZES:
            more = size * np.maximum(values, 0.0)[:, None]
            kept = more / (1.0 + more)
            logs.append(0.5 * float((kept * across**2 - np.log1p(more)).sum()))
            mean = (vectors @ (kept * across)) * np.sqrt(d.prepared.variance)
            counts.append(d.gap(mean.ravel()) >= COUNTS)
    probable = float(softmax(logs)[counts].sum())
    word = UNKNOWN if probable > 0.5 else NONE
    return Claim(word, (), {UNKNOWN: probable, NONE: 1.0 - probable})


BASELINES: dict[str, Callable[[Recording], Claim]] = {
    "none": none, "bic": bic, "lasso": lasso, "everything": everything, "black-box": black_box,
}  # fmt: skip
"""Baselines by the name under which `wrenchbed blind run --method` knows them."""
