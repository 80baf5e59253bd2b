"""How far the gap shrinks: the twin runs in MuJoCo on rows that took no part in any fit.

A black box: a flexible model of the residual, which closes a gap and names nothing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchbed.diagnosis.evidence.dictionary import STATED, variables
from wrenchbed.diagnosis.explain.analysis import Analysis
from wrenchbed.diagnosis.explain.claims import beside
from wrenchbed.diagnosis.explain.finalist import Finalist
from wrenchbed.diagnosis.prepare import noise
from wrenchbed.diagnosis.prepare.baseline import BIAS
from wrenchbed.diagnosis.prepare.prepared import Prepared
from wrenchbed.effects.chain import ActiveEffect, respond
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.simulation.closed_form import Model
from wrenchbed.twin.twin import Twin

ZERO, MASS, COG = STATED
RIDGES = 10.0 ** np.arange(-3.0, 3.0, 0.5)
"""Prior variances of a coefficient, in noises of a row, that are tried."""


def black_box(prepared: Prepared, reading: np.ndarray) -> np.ndarray:
    """What a ridge regression on all kernels adds to readings (M, 6) of a simulator.

    Fitted on the unsealed rows, channel by channel; its one size is the one of largest evidence.
    """
    held, fit = prepared.scene.held, ~prepared.sealed
    x = np.concatenate(list(variables(prepared).values()), axis=1)
    x = (x - x[fit].mean(axis=0)) / np.maximum(x[fit].std(axis=0), 1e-9)
    x = np.column_stack([np.ones(len(x)), x])
    target = (prepared.y - reading[held]) @ prepared.turn.T
    use = np.flatnonzero(fit)[:: prepared.stride]
    u, s, vt = np.linalg.svd(x[use], full_matrices=False)
    turned, rest = u.T @ target[use], (target[use] ** 2).sum() - ((u.T @ target[use]) ** 2).sum()
    noise = float(prepared.noise.mean())
    loose = target[use].size - turned.size

    def evidence(prior: float, level: float) -> float:
        k = (s**2 * prior + level)[:, None]
        fitted = (turned**2 / k).sum() + 6 * np.log(k).sum()
        return -0.5 * float(fitted + rest / level + loose * np.log(level))

    levels = noise * 2.0 ** np.arange(0.0, 8.0)
    prior, level = max(((p, v) for p in RIDGES for v in levels), key=lambda t: evidence(*t))
    shrunk = (s * prior / (s**2 * prior + level))[:, None] * turned
    guess = x @ (vt.T @ shrunk) @ np.linalg.inv(prepared.turn).T
    result = np.zeros_like(reading)
    result[held] = guess
    return result


DRAWS = 500
"""Of the bootstrap over sealed blocks."""


@dataclass(frozen=True, eq=False)
class Closure:
    """Gaps on sealed rows (`docs/reference/nomenclature.md`: 0 when only noise is left).

    Attributes:
        configured, calibrated, with_effects, floor: of the simulator as stated, after bias, mass
            and CoG, with the claimed effects, and of noise alone.
        closed: share of the gap that the effects close, with its 95 % interval.
        black_box: share that a flexible model of the residual closes.
        rows: sealed rows.
        per_channel: gap per channel before and after.
        shares: share of the closed gap that each effect takes back when left out, by name.
    """

    configured: float
    calibrated: float
    with_effects: float | None
    floor: float
    closed: float | None
    interval: tuple[float, float] | None
    black_box: float | None
    rows: int
    per_channel: Mapping[str, Mapping[str, float]]
    shares: Mapping[str, float]


def twin_of(a: Analysis, f: Finalist, keep: Sequence[int]) -> Twin:
    """The twin with some parts of a finalist, and the stated numbers as they come out beside it."""
    values = a.refitter.values(f.parts, f.x)
    active = tuple(ActiveEffect(f.parts[k].effect, values[k]) for k in keep)
    return Twin(a.prepared.model, corrected(a, f), active, a.prepared.recording.name)


def corrected(a: Analysis, f: Finalist) -> np.ndarray:
    """Full parameters (P,) with bias, mass and CoG as they come out beside a finalist."""
    d, model = a.dictionary, a.prepared.model
    error = beside(a.refitter, f) * d.size[d.stated]
    by = {e: error[[d.label[k][0] == e for k in d.stated]] for e in STATED}
    theta = a.prepared.theta.copy()
    n = len(model.robot.parameters)
    tool = model.robot.tool(theta[:n])
    mass = float(tool.mass) + float(by[MASS][0])
    cog = np.asarray(tool.cog, dtype=float) + by[COG]
    return with_load(model, theta, mass, cog, by[ZERO])


def with_load(
    model: Model, theta: np.ndarray, mass: float, cog: np.ndarray, bias: np.ndarray
) -> np.ndarray:
    """Full parameters (P,) with a tool [kg, m] and a bias (6,) [N, N·m]."""
    n = len(model.robot.parameters)
    result = theta.copy()
    result[:n] = model.robot.theta_of_tool(theta[:n], mass, [float(c) for c in cog])
    for name, value in zip(BIAS, bias, strict=True):
        result[model.parameters.index(name)] = value
    return result


class HeldOut:
    """Gaps of simulators on the sealed rows of a recording."""

    def __init__(self, prepared: Prepared) -> None:
        self.prepared = prepared
        self._root = np.linalg.inv(np.linalg.cholesky(prepared.covariance))
        self._std = np.sqrt(np.diagonal(prepared.covariance))
        sealed = prepared.sealed
        self.y, self.count = prepared.y[sealed], prepared.count[sealed]
        self.block = prepared.block[sealed]
        scatter = prepared.scatter
        white = np.einsum("ij,hjk,ik->h", self._root, scatter, self._root)
        self.noise = white[sealed] / 6 - 1.0
        self.channel_noise = np.einsum("hii->hi", scatter)[sealed] / self._std**2 - 1.0

    @property
    def rows(self) -> int:
        return int(self.count.sum())

    def of(self, reading: np.ndarray) -> np.ndarray:
        """Gap of each sealed observation (S,) for scene readings (M, 6)."""
        r = self.y - reading[self.prepared.scene.held][self.prepared.sealed]
        return np.asarray(((r @ self._root.T) ** 2).mean(axis=1) + self.noise)

    def channels(self, reading: np.ndarray) -> np.ndarray:
        """Gap of each channel (6,)."""
        r = self.y - reading[self.prepared.scene.held][self.prepared.sealed]
        told = (r / self._std) ** 2 + self.channel_noise
        return np.asarray((told * self.count[:, None]).sum(axis=0) / self.count.sum())

    def mean(self, gaps: np.ndarray) -> float:
        """Mean over rows of gaps (S,)."""
        return float((gaps * self.count).sum() / self.count.sum())

    def floor(self) -> np.ndarray:
        """Gap of noise alone (S,): rows about their mean, or of a motion what no gap moves like.

        Second differences would miss most of a noise with memory.
        """
        p = self.prepared
        if p.moving:
            residual = (p.y - respond(p.scene)[p.scene.held]) @ self._root.T
            variance, _ = noise.noise(residual, p.scene.period, p.stride)
            shown = np.count_nonzero(p.count) / len(p.count)  # what repeats hardly scatters
            return np.full(len(self.y), float(variance.mean()) / shown - 1.0)
        if self.prepared.recording.metadata.mode == "dynamic":  # averages of a motion
            return np.asarray(self.noise + float(self.prepared.noise.mean()))
        n = np.maximum(self.count, 2)
        repeated = (self.noise + 1.0) * n / (n - 1) - 1.0
        return np.asarray(np.where(self.count > 1, repeated, 0.0))


def measure(a: Analysis, twin: Twin | None, wrong: Sequence[str], seed: int = 0) -> Closure:
    """Run the configured, calibrated and diagnosed simulators on the sealed rows."""
    p, sealed = a.prepared, HeldOut(a.prepared)
    model = p.model
    configured = sealed.of(Twin(model, p.theta).wrench(p.scene))
    before = calibrated(a).wrench(p.scene)
    fitted, floor = sealed.of(before), sealed.floor()
    box = sealed.mean(sealed.of(before + black_box(p, before)))
    base = sealed.mean(fitted)
    scale = base - sealed.mean(floor)
    flexible = None if scale <= 0 else (base - box) / scale
    start = sealed.channels(before)
    if twin is None:
        told = {c: {"before": float(v)} for c, v in zip(CHANNELS, start, strict=True)}
        return Closure(
            sealed.mean(configured), base, None, sealed.mean(floor), None, None, flexible,
            sealed.rows, told, {},
        )  # fmt: skip
    after = twin.wrench(p.scene)
    with_effects = sealed.of(after)
    origin = configured if wrong and not twin.active else fitted
    closed, interval = _closed(sealed, origin, with_effects, floor, seed)
    end = sealed.channels(after)
    told = {
        c: {"before": float(v), "after": float(w)}
        for c, v, w in zip(CHANNELS, start, end, strict=True)
    }
    shares = _shares(a, twin, sealed, with_effects, closed or 0.0, wrong)
    return Closure(
        sealed.mean(configured), base, sealed.mean(with_effects), sealed.mean(floor), closed,
        interval, flexible, sealed.rows, told, shares,
    )  # fmt: skip


def _closed(
    sealed: HeldOut, origin: np.ndarray, end: np.ndarray, floor: np.ndarray, seed: int
) -> tuple[float | None, tuple[float, float] | None]:
    """Share closed and its 95 % interval, by drawing sealed blocks anew."""
    blocks = np.unique(sealed.block)
    weight = sealed.count.astype(float)
    gain = np.array([((origin - end) * weight)[sealed.block == b].sum() for b in blocks])
    whole = np.array([((origin - floor) * weight)[sealed.block == b].sum() for b in blocks])
    if whole.sum() <= 0:
        return None, None
    rng = np.random.default_rng([seed, 30])
    drawn = rng.integers(len(blocks), size=(DRAWS, len(blocks)))
    ratio = gain[drawn].sum(axis=1) / np.where(
        whole[drawn].sum(axis=1) > 0, whole[drawn].sum(axis=1), np.nan
    )
    low, high = np.nanquantile(ratio, [0.025, 0.975])
    return float(gain.sum() / whole.sum()), (float(low), float(high))


def _shares(
    a: Analysis, twin: Twin, sealed: HeldOut, full: np.ndarray, closed: float, wrong: Sequence[str]
) -> dict[str, float]:
    """The closed share among the causes, by how much of the gap comes back without each."""
    scene, result = a.prepared.scene, {}
    for k, active in enumerate(twin.active):
        rest = replace(twin, active=tuple(x for i, x in enumerate(twin.active) if i != k))
        result[active.effect.name] = sealed.mean(sealed.of(rest.wrench(scene)) - full)
    for name in wrong:
        rest = replace(twin, theta=_as_stated(a, twin, name))
        result[name] = sealed.mean(sealed.of(rest.wrench(scene)) - full)
    total = sum(max(v, 0.0) for v in result.values())
    return {k: closed * max(v, 0.0) / total if total > 0 else 0.0 for k, v in result.items()}


def _as_stated(a: Analysis, twin: Twin, name: str) -> np.ndarray:
    """The twin's parameters with one number as the metadata states it."""
    model, n = twin.model, len(twin.model.robot.parameters)
    now, then = model.robot.tool(twin.own), model.robot.tool(a.prepared.theta[:n])
    bias = np.array([twin.theta[model.parameters.index(b)] for b in BIAS])
    mass = float((then if name == MASS else now).mass)
    cog = np.asarray((then if name == COG else now).cog, dtype=float)
    return with_load(model, twin.theta, mass, cog, 0.0 * bias if name == ZERO else bias)


def calibrated(a: Analysis) -> Twin:
    """The simulator after bias, mass and CoG are fitted."""
    b, p = a.baseline, a.prepared
    theta = with_load(p.model, p.theta, b.mass, b.cog, b.bias)
    return Twin(p.model, theta, (), p.recording.name)
