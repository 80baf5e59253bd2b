"""How far the gap shrinks: the twin runs in MuJoCo on rows that took no part in any fit.

Beside it a black box, a flexible model of the residual: it closes a gap and names nothing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchbed.diagnosis.evidence.dictionary import variables
from wrenchbed.diagnosis.explain.claims import beside
from wrenchbed.diagnosis.explain.refit import Finalist
from wrenchbed.diagnosis.explain.structures import Analysis
from wrenchbed.diagnosis.gap.held_out import HeldOut
from wrenchbed.diagnosis.prepare.configuration import STATED, Configuration
from wrenchbed.diagnosis.prepare.prepared import Prepared
from wrenchbed.effects.chain import ActiveEffect
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.twin.twin import Twin

RIDGES = 10.0 ** np.arange(-3.0, 3.0, 0.5)
"""Prior variances of a coefficient, in noises of a row, that are tried."""
NOISES = 2.0 ** np.arange(0.0, 8.0)
"""Variances of what the box does not fit, in noises of a row, that are tried."""


def black_box(prepared: Prepared, reading: np.ndarray) -> np.ndarray:
    """What a ridge regression on all kernels adds to readings (M, 6) of a simulator.

    Fitted on the rows of the fit, channel by channel, with the prior of largest evidence.
    """
    held, fit = prepared.scene.held, ~prepared.sealed
    x = np.concatenate(list(variables(prepared).values()), axis=1)
    x = (x - x[fit].mean(axis=0)) / np.maximum(x[fit].std(axis=0), 1e-9)
    x = np.column_stack([np.ones(len(x)), x])
    use = np.flatnonzero(fit)[:: prepared.stride]
    target = ((prepared.y - reading[held]) / prepared.sigma)[use]
    u, s, vt = np.linalg.svd(x[use], full_matrices=False)
    inside = u.T @ target
    outside = (target**2).sum() - (inside**2).sum()
    free = target.size - inside.size

    def evidence(prior: float, noise: float) -> float:
        k = (s**2 * prior + noise)[:, None]
        fitted = (inside**2 / k).sum() + 6 * np.log(k).sum()
        return -0.5 * float(fitted + outside / noise + free * np.log(noise))

    noises = float(prepared.noise.mean()) * NOISES
    prior, noise = max(((p, v) for p in RIDGES for v in noises), key=lambda t: evidence(*t))
    shrunk = (s * prior / (s**2 * prior + noise))[:, None] * inside
    result = np.zeros_like(reading)
    result[held] = x @ (vt.T @ shrunk) * prepared.sigma
    return result


DRAWS = 500
"""Of the bootstrap over held-out blocks."""


@dataclass(frozen=True, eq=False)
class Closure:
    """Gaps on held-out rows (`docs/nomenclature.md`: 0 when only noise is left).

    Attributes:
        configured, calibrated, with_effects, floor: of the simulator as stated, after bias, mass
            and CoG, with the claimed effects, and of noise alone.
        closed: share of the gap that the effects close, with its 95 % interval.
        black_box: share that a flexible model of the residual closes.
        rows: held-out rows.
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


def calibrated(a: Analysis) -> Twin:
    """The simulator after bias, mass and CoG are fitted."""
    return Twin(a.prepared.model, a.baseline.configuration.theta, (), a.prepared.recording.name)


def twin_of(a: Analysis, f: Finalist, keep: Sequence[int]) -> Twin:
    """The twin with some parts of a finalist, and the stated numbers as they come out beside it."""
    values = a.refitter.values(f.parts, f.x)
    active = tuple(ActiveEffect(f.parts[k].effect, values[k]) for k in keep)
    return Twin(a.prepared.model, corrected(a, f).theta, active, a.prepared.recording.name)


def corrected(a: Analysis, f: Finalist) -> Configuration:
    """The configured simulator with bias, mass and CoG as they come out beside a finalist."""
    d, stated = a.dictionary, a.prepared.configuration
    error = beside(a.refitter, f) * d.size[d.stated]
    bias, mass, cog = (error[d.of_stated(effect)] for effect in STATED)
    return stated.with_load(stated.mass + float(mass[0]), stated.cog + cog, bias)


def measure(a: Analysis, twin: Twin | None, wrong: Sequence[str], seed: int = 0) -> Closure:
    """Run the configured, calibrated and diagnosed simulators on the held-out rows.

    Args:
        twin: the diagnosed one, None where no cause is claimed.
        wrong: stated numbers that are claimed to be wrong.
        seed: of the bootstrap.
    """
    p, held_out = a.prepared, HeldOut(a.prepared)
    configured = held_out.of(Twin(p.model, p.theta).wrench(p.scene))
    before = calibrated(a).wrench(p.scene)
    fitted, floor = held_out.of(before), held_out.floor()
    box = held_out.mean(held_out.of(before + black_box(p, before)))
    base = held_out.mean(fitted)
    scale = base - held_out.mean(floor)
    channels = {"before": held_out.channels(before)}
    with_effects, closed, interval = None, None, None
    shares: dict[str, float] = {}
    if twin is not None:
        after = twin.wrench(p.scene)
        gaps = held_out.of(after)
        with_effects = held_out.mean(gaps)
        origin = configured if wrong and not twin.active else fitted
        closed, interval = _closed(held_out, origin, gaps, floor, seed)
        channels["after"] = held_out.channels(after)
        shares = _shares(a, twin, held_out, gaps, closed or 0.0, wrong)
    return Closure(
        configured=held_out.mean(configured),
        calibrated=base,
        with_effects=with_effects,
        floor=held_out.mean(floor),
        closed=closed,
        interval=interval,
        black_box=None if scale <= 0 else (base - box) / scale,
        rows=held_out.rows,
        per_channel={
            c: {stage: float(gap[k]) for stage, gap in channels.items()}
            for k, c in enumerate(CHANNELS)
        },
        shares=shares,
    )


def _closed(
    held_out: HeldOut, origin: np.ndarray, end: np.ndarray, floor: np.ndarray, seed: int
) -> tuple[float | None, tuple[float, float] | None]:
    """Share closed and its 95 % interval, by drawing held-out blocks anew."""
    blocks = np.unique(held_out.block)
    weight = held_out.count.astype(float)

    def by_block(gaps: np.ndarray) -> np.ndarray:
        return np.array([(gaps * weight)[held_out.block == b].sum() for b in blocks])

    gain, total = by_block(origin - end), by_block(origin - floor)
    if total.sum() <= 0:
        return None, None
    rng = np.random.default_rng([seed, 30])
    drawn = rng.integers(len(blocks), size=(DRAWS, len(blocks)))
    scale = total[drawn].sum(axis=1)
    ratio = gain[drawn].sum(axis=1) / np.where(scale > 0, scale, np.nan)
    low, high = np.nanquantile(ratio, [0.025, 0.975])
    return float(gain.sum() / total.sum()), (float(low), float(high))


def _shares(
    a: Analysis, twin: Twin, held_out: HeldOut, full: np.ndarray, closed: float,
    wrong: Sequence[str],
) -> dict[str, float]:  # fmt: skip
    """The closed share among the causes, by how much of the gap comes back without each."""
    without = {
        active.effect.name: replace(twin, active=twin.active[:k] + twin.active[k + 1 :])
        for k, active in enumerate(twin.active)
    }
    without |= {name: replace(twin, theta=_as_stated(a, twin, name).theta) for name in wrong}
    scene = a.prepared.scene
    back = {k: held_out.mean(held_out.of(t.wrench(scene)) - full) for k, t in without.items()}
    total = sum(max(v, 0.0) for v in back.values())
    return {k: closed * max(v, 0.0) / total if total > 0 else 0.0 for k, v in back.items()}


def _as_stated(a: Analysis, twin: Twin, name: str) -> Configuration:
    """The twin's simulator with one number as the metadata states it."""
    bias, mass, cog = STATED
    now, stated = Configuration(twin.model, twin.theta), a.prepared.configuration
    return now.with_load(
        (stated if name == mass else now).mass,
        (stated if name == cog else now).cog,
        0.0 * now.bias if name == bias else now.bias,
    )
