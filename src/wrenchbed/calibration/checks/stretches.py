"""What is wrong in a part of a recording only: contact, several tools, a jump of the zero.

One load is fitted to the half of the observations that agrees best (least trimmed squares,
Rousseeuw & Van Driessen 2006, doi 10.1007/s10618-005-0024-4); observations far from it are named
with their times. A change of load is found by fits before and after each moment.
"""

import numpy as np

from wrenchbed.calibration.checks.finding import Finding
from wrenchbed.calibration.checks.mistakes import CLEAN, MENDED, part, thinned
from wrenchbed.calibration.checks.rigid_load import Observed
from wrenchbed.data.holds import runs
from wrenchbed.physics.rigid_load_regressor import INERTIAL

STARTS, STEPS = 40, 12
"""Random starts and concentration steps of the trimmed fit: with a quarter of
wrong rows forty starts of six miss a clean one with a chance of 4e-4."""
KEPT = 0.6
"""Fraction of the observations that a trimmed fit explains, so that up to 40 % may be contact: at
one half noise decides which half is kept, near 1 a long contact pulls the fit."""
FAR = 8.0
"""Least distance of an observation in contact from the load, in robust standard deviations."""
PUSH = 0.15
"""Least distance of an observation in contact from the load, over the load's swing of force."""
MOMENTS = 40
"""Number of times, evenly spread over a recording, at which a change is tried."""
SIMPLER = 0.5
"""Residual with a new load over that with a new zero, below which the load is named."""
MOST_NAMED = 8
"""Most stretches of rows that are named: they fill two lines."""
LEAST_SIDE = 8
"""Fewest observations on either side of a change."""
_MAD = 1.4826


def trimmed(seen: Observed) -> tuple[np.ndarray, np.ndarray]:
    """Residual (M, 6) [N, N·m] of the load that explains the larger part of the observations best,
    and the residual's robust standard deviation (6,)."""
    d, y, scale = _scaled(seen)
    kept, rng = int(KEPT * len(seen)), np.random.default_rng(0)
    best, least = y, np.inf
    for _ in range(STARTS):
        rows = rng.permutation(len(seen))[:6]
        for _ in range(STEPS):
            residual = y - d @ _solution(d[rows], y[rows])
            size = (residual**2).sum(axis=1)
            order = np.argsort(size)[:kept]
            if set(order) == set(rows):
                break
            rows = order
        cost = float(np.sort(size)[:kept].sum())
        if cost < least:
            best, least = residual, cost
    spread = _MAD * np.median(np.abs(best), axis=0)
    return best * scale, spread * scale


def _scaled(seen: Observed) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Regressor of load and bias (M, 6, 16) and readings (M, 6), divided by the largest standard
    deviation of a force or of a torque channel; and that divisor (6,)."""
    d = np.concatenate([seen.design, np.broadcast_to(np.eye(6), (len(seen), 6, 6))], axis=2)
    force = float(seen.y[:, :3].std(axis=0).max())
    scale = np.repeat([force, max(float(seen.y[:, 3:].std(axis=0).max()), 0.02 * force)], 3)
    scale = np.maximum(scale, 1e-300)
    return d / scale[:, None], seen.y / scale, scale


def _solution(d: np.ndarray, y: np.ndarray) -> np.ndarray:
    flat = d.reshape(-1, d.shape[2])
    size = np.maximum(np.linalg.norm(flat, axis=0), 1e-12)
    unit = flat / size
    normal = unit.T @ unit + 1e-8 * np.eye(len(size))
    return np.asarray(np.linalg.solve(normal, unit.T @ y.ravel()) / size)


def touched(seen: Observed) -> Finding | None:
    """Finding if a contact force acts during part of the recording; else None."""
    some = thinned(seen)
    if len(some) < 2 * LEAST_SIDE:
        return None
    residual, spread = trimmed(some)
    noise = np.maximum(np.maximum(spread, some.noise), 1e-300)
    swing = float(some.y[:, :3].std(axis=0).max())
    force = np.linalg.norm(residual[:, :3], axis=1)
    torque = np.abs(residual[:, 3:]).max(axis=1)
    torque_swing = max(float(some.y[:, 3:].std(axis=0).max()), 0.05 * swing)
    off = (force > PUSH * swing) | (torque > PUSH * torque_swing)
    far = off & (np.abs(residual / noise).max(axis=1) > FAR)
    if not far.any() or far.mean() > 1.0 - KEPT:
        return None
    rest = part(some, ~far)
    if rest.moments.fit().share > CLEAN:
        return None
    return Finding(
        "contact", _where(some, far, float(force[far].max()), residual[far]), blocks=False
    )


def _where(seen: Observed, far: np.ndarray, peak: float, residual: np.ndarray) -> str:
    every, row = runs(far), seen.row
    strength = f"up to {peak:.3g} N and {np.abs(residual[:, 3:]).max():.2g} N·m"
    kind = "samples" if not isinstance(seen.q, np.ndarray) else "poses"
    begin = seen.t[max(every, key=lambda run: run[1] - run[0])[0]]
    rows = [f"{row[a]} to {row[b] - 1}" if b < len(seen) else f"{row[a]} on" for a, b in every]
    more = f", and {len(rows) - MOST_NAMED} stretches more" if len(rows) > MOST_NAMED else ""
    return (
        f"contact or a hand: {strength} that no weight makes, in {far.sum()} of {len(far)} {kind}, "
        f"the longest from {begin:.1f} s on. Leave out rows {', '.join(rows[:MOST_NAMED])}{more}, "
        "or record again without touching the tool"
    )


def changed(seen: Observed) -> Finding | None:
    """Finding if the load or a zero changes at some moment of the recording; else None."""
    some = thinned(seen)
    before = some.moments.fit().share
    if len(some) < 2 * LEAST_SIDE:
        return None
    d, y, _ = _scaled(some)
    total = float(((y - y.mean(axis=0)) ** 2).sum())

    def left(at: int, kind: slice) -> float:
        late = (np.arange(len(some)) >= at)[:, None, None]
        both = np.concatenate([d, late * d[:, :, kind]], axis=2)
        return float(((y - both @ _solution(both, y)) ** 2).sum()) / max(total, 1e-300)

    tried = np.unique(np.linspace(LEAST_SIDE, len(some) - LEAST_SIDE, MOMENTS).astype(int))
    near = int(np.diff(tried).max(initial=1))
    rest, at, kind = np.inf, 0, "zero"
    for name, columns in (("zero", slice(INERTIAL, None)), ("load", slice(0, INERTIAL))):
        coarse = min(tried, key=lambda k: left(int(k), columns))
        fine = range(max(LEAST_SIDE, coarse - near), min(len(some) - LEAST_SIDE, coarse + near) + 1)
        best = min((left(k, columns), k) for k in fine)
        if best[0] < rest * SIMPLER:
            rest, at, kind = *best, name
    if rest > MENDED * before or rest > CLEAN:
        return None
    row, moment = some.row[at], some.t[at]
    if kind == "zero":
        return Finding(
            "zero jumps",
            f"the zero of the sensor jumps at {moment:.1f} s (row {row}): it was zeroed again, or "
            "something leans on the tool from there on. Calibrate the parts one by one",
            blocks=False,
        )
    late = np.arange(len(some)) >= at
    masses = [part(some, rows).moments.fit().phi[0] for rows in (~late, late)]
    return Finding(
        "several tools",
        f"the load is another from {moment:.1f} s (row {row}) on: {masses[0]:.3g} kg, then "
        f"{masses[1]:.3g} kg: several tools in one file. Import each on its own",
        blocks=False,
    )
