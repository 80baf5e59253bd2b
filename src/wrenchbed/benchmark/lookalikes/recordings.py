"""Readings of a case: full recordings row by row, or the means of its holds.

Noise of rows has heavy tails, memory, correlation between channels and a slow wander. Its ranges
are estimates.
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from wrenchbed.benchmark.lookalikes.case import LookalikeCase
from wrenchbed.benchmark.lookalikes.design import ExperimentDesign
from wrenchbed.benchmark.lookalikes.imperfection import held_rows, slow_noise
from wrenchbed.data.recording import QUATERNION, Recording
from wrenchbed.physics.wrench import CHANNELS

WANDER = 0.3
"""Largest rms of the wander between holds in noises of one row: a gap below 0.1."""
_ENCODER = 4e-6
"""Scatter of joint readings at rest, in motion a hundredth of it [rad or m]."""
_FEW = 10
"""With fewer rows a mean is not Gaussian: rows are drawn."""


def recording(design: ExperimentDesign, case: LookalikeCase) -> Recording:
    """All rows of a case, with noise, clock jitter and everything that happens between rows."""
    rng = np.random.default_rng([case.seed, 3])
    rows = _rows(design, case)
    count, samples = rows.shape[:2]
    offset = (np.arange(samples) - (samples - 1) / 2.0) / design.rate
    if design.moving:
        t = design.t
    else:
        jitter = np.clip(rng.normal(0.0, 0.04, (count, samples)), -0.3, 0.3) / design.rate
        t = (design.t[:, None] + offset + jitter).ravel()
        least = 1e-3 / design.rate * np.arange(len(t))  # holds of uneven length may touch
        t = np.maximum.accumulate(t - least) + least
        t = t - min(0.0, float(t[0]))
    q = np.repeat(design.q, samples, axis=0)
    q = q + rng.normal(0.0, _ENCODER * (0.01 if design.moving else 1.0), q.shape)
    names: tuple[str, ...] = QUATERNION
    if design.has_joints:
        names = tuple(f"q{j + 1}" for j in range(q.shape[1]))
    else:
        q = q / np.linalg.norm(q, axis=1, keepdims=True)
    y = rows.reshape(-1, 6)
    segment = np.zeros(count) if design.moving else np.arange(count)
    columns = {"t": t, "segment": np.repeat(segment.astype(np.int64), samples)}
    columns |= {name: q[:, j] for j, name in enumerate(names)}
    columns |= {c: y[:, k] for k, c in enumerate(CHANNELS)}
    if design.temperature is not None:
        warm = np.repeat(design.temperature, samples)
        columns["temperature"] = np.round(warm + rng.normal(0.0, 0.02, len(warm)), 2)
    return Recording(design.metadata, columns, f"lookalike-{case.seed}")


def means(design: ExperimentDesign, case: LookalikeCase) -> np.ndarray:
    """Means of the holds (H, 6) [N, N·m], or the rows of a motion, with their noise."""
    changed = [i.rows for i, _ in case.items if i.rows is not None]
    coarse = any((r.step > 1.5 * design.noise_std).any() for r in changed)
    clipped = any(np.isfinite(r.limit).any() for r in changed)
    if design.moving or design.samples < _FEW or coarse or clipped:
        return _rows(design, case).mean(axis=1)
    rng = np.random.default_rng([case.seed, 2])
    law = noise_law(rng)
    y = case.clean + wander(design, law, rng)
    scatter = mean_noise(design, law, rng, design.samples)
    for r in changed:
        scatter = scatter * r.gain
    for r in changed:
        if r.shake is not None:
            tone = rng.standard_normal((len(design), 1))
            scatter = scatter + r.shake * tone / np.sqrt(design.samples)
    return y + scatter


@dataclass(frozen=True, eq=False)
class NoiseLaw:
    """How one robot's rows scatter, in units of ``noise_std``.

    Attributes:
        level: per channel (6,), about 1.
        tails: share of rows that are Student-t with ``freedom`` degrees of freedom.
        freedom: 4 to 8.
        memory: share of the variance that is AR(1) with coefficient ``keep``.
        keep: 0 to 0.6.
        mixing: (6, 6) root of the correlation between channels.
        wander: rms of the wander per channel (6,).
    """

    level: np.ndarray
    tails: float
    freedom: float
    memory: float
    keep: float
    mixing: np.ndarray
    wander: np.ndarray


def noise_law(rng: np.random.Generator) -> NoiseLaw:
    """A random law."""
    lean = 0.25 * rng.standard_normal((6, 6))
    root = np.eye(6) + lean
    root = root / np.linalg.norm(root, axis=1, keepdims=True)
    return NoiseLaw(
        level=rng.uniform(0.95, 1.05, 6),
        tails=rng.uniform(0.0, 0.7),
        freedom=rng.uniform(4.0, 8.0),
        memory=rng.uniform(0.0, 0.6),
        keep=rng.uniform(0.0, 0.6),
        mixing=root,
        wander=rng.uniform(0.0, WANDER) * rng.uniform(0.6, 1.0, 6),
    )


def row_noise(
    design: ExperimentDesign, law: NoiseLaw, rng: np.random.Generator, samples: int
) -> np.ndarray:
    """Noise (H, samples, 6) [N, N·m], without the wander; in motion one run of all rows."""
    count = len(design)
    shape = (1, count, 6) if design.moving else (count, samples, 6)
    white = rng.standard_normal(shape)
    heavy = rng.uniform(size=shape[:2]) < law.tails
    spread = np.sqrt((law.freedom - 2.0) / rng.chisquare(law.freedom, shape[:2]))
    white *= np.where(heavy, spread, 1.0)[..., None]
    kicks = rng.standard_normal(shape) * np.sqrt(1.0 - law.keep**2)
    initial = law.keep * rng.standard_normal((shape[0], 1, 6))
    slow = lfilter([1.0], [1.0, -law.keep], kicks, axis=1, zi=initial)[0]
    unit = np.sqrt(1.0 - law.memory) * white + np.sqrt(law.memory) * slow
    mixed = unit @ law.mixing.T * (law.level * design.noise_std)
    return mixed.reshape(count, -1, 6)


def mean_noise(
    design: ExperimentDesign, law: NoiseLaw, rng: np.random.Generator, samples: int
) -> np.ndarray:
    """Noise of the means of ``samples`` rows (H, 6), without the wander."""
    n, a = samples, law.keep
    together = (1.0 + a) / (1.0 - a) - 2.0 * a * (1.0 - a**n) / (n * (1.0 - a) ** 2)
    variance = ((1.0 - law.memory) + law.memory * together) / n
    unit = rng.standard_normal((len(design), 6)) @ law.mixing.T
    return np.asarray(np.sqrt(variance) * unit * law.level * design.noise_std)


def wander(design: ExperimentDesign, law: NoiseLaw, rng: np.random.Generator) -> np.ndarray:
    """1/f wander (N, 6) [N, N·m] over the run."""
    return slow_noise(rng, len(design), 6) * law.wander * design.noise_std


def _rows(design: ExperimentDesign, case: LookalikeCase) -> np.ndarray:
    """Rows (N, samples, 6) [N, N·m]."""
    rng = np.random.default_rng([case.seed, 2])
    law = noise_law(rng)
    samples = 1 if design.moving else design.samples
    slow = wander(design, law, rng)
    scatter = row_noise(design, law, rng, samples)
    load = case.unclipped
    if design.moving:  # the clock of the sensor jitters
        late = np.clip(rng.normal(0.0, 1.5e-4, len(load)), -5e-4, 5e-4)
        load = load + late[:, None] * np.gradient(load, design.t, axis=0)
    y = (load + slow)[:, None, :]
    changed = [i.rows for i, _ in case.items if i.rows is not None]
    for r in changed:
        scatter = scatter * r.gain
    y = y + scatter
    when = design.t[:, None] + np.arange(samples) / design.rate
    for r in changed:
        if r.shake is not None:
            y = y + r.shake[:, None, :] * _shaking(when, r.frequency, rng)[..., None]
    for r in changed:
        step = np.where(r.step > 0.0, r.step, 1.0)
        y = np.where(r.step > 0.0, np.round(y / step) * step, y)
    for r in changed:
        y = np.clip(y, -r.limit, r.limit)
    for r in changed:
        if r.stale[0] > 0.0:
            flat = y.reshape(-1, 6)
            y = flat[held_rows(len(flat), r.stale, rng)].reshape(y.shape)
    return y


def _shaking(t: np.ndarray, frequency: float, rng: np.random.Generator) -> np.ndarray:
    """A signal of unit rms at times (N, n) [s]: a line whose amplitude breathes, or broad."""
    if frequency <= 0.0:
        return rng.standard_normal(t.shape)
    breath = 0.3 * np.sin(0.11 * frequency * t + rng.uniform(0.0, 6.28))
    wave = np.sin(2.0 * np.pi * frequency * t + rng.uniform(0.0, 6.28))
    return np.asarray(np.sqrt(2.0) * (1.0 + breath) * wave / np.sqrt(1.0 + 0.045))
