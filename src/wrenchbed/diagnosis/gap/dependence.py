"""What a residual may vary with: an orthonormal basis for each variable, and a test of them all.

The test permutes whole poses, or stretches of a motion, of all channels together; the usual fit
(bias, mass, CoG) is repeated on each permuted residual (Freedman & Lane 1983, doi 10.2307/1391660).
The largest studentised likelihood ratio over all variables gives family-wise p-values (Westfall &
Young 1993).
"""

import numpy as np

from wrenchbed.diagnosis.evidence.dictionary import harmonics, nuisance, variables
from wrenchbed.diagnosis.prepare.bias_and_load_fit import load_slopes
from wrenchbed.diagnosis.prepare.prepared import Prepared
from wrenchbed.effects.scene import held_on
from wrenchbed.physics.taylor_jets import Jet, value

SHARED_ROWS = 3
"""Fewest rows for each function of a variable; further functions are left out."""
_RANK = 1e-6
_DEGREE_2 = 8
"""Number of harmonics of gravity's direction up to degree 2."""
_TURN = 1e-5
"""Finite-difference step of a joint for the derivative of gravity's direction [rad or m]."""
_DUPLICATE = 1e-3
"""Squared rest of a unit vector, beyond earlier functions, below which it counts as explained."""


class Partitions:
    """Bases of functions of each of V variables that changes, at the R rows of the fit.

    Attributes:
        names: names of the variables (V,).
        bases: basis of each variable's functions (C, R, k), orthonormal in each whitened channel,
            without a mean; columns of 0 where the functions depend on each other.
        fitted: orthonormal basis of the fit of bias, mass and CoG (C R, n).
    """

    def __init__(self, prepared: Prepared) -> None:
        each = _functions(prepared).items()
        every = {name: _orthonormal(_on_rows(prepared, functions)) for name, functions in each}
        groups = {name: basis for name, basis in every.items() if basis.shape[2]}
        self.names, self.bases = tuple(groups), tuple(groups.values())
        self.fitted = _fitted(prepared)

    def explained(self, y: np.ndarray) -> np.ndarray:
        """Log likelihood ratio (V, n) of each variable for residuals (C, R, n), per row.

        Each channel has its own noise level: −Σ log(1 − share of the channel's energy explained).
        """
        stacked = np.concatenate(self.bases, axis=2)
        parts = (np.swapaxes(stacked, 1, 2) @ y) ** 2  # (C, K, n)
        first = np.cumsum([0, *(b.shape[2] for b in self.bases[:-1])])
        total = np.maximum(np.einsum("crn,crn->cn", y, y), 1e-300)[:, None]
        share = np.add.reduceat(parts, first, axis=1) / total
        return np.asarray(-np.log(np.maximum(1.0 - share, 1e-9)).sum(axis=0))

    def without_fitted(self, y: np.ndarray) -> np.ndarray:
        """Residuals (C, R, n) less their least-squares fit by bias, mass and CoG."""
        flat = np.swapaxes(y, 0, 1).reshape(-1, y.shape[2])
        flat = flat - self.fitted @ (self.fitted.T @ flat)
        return np.asarray(np.swapaxes(flat.reshape(y.shape[1], len(y), -1), 0, 1))


def family_wise(
    parts: Partitions, residual: np.ndarray, block: np.ndarray, permutations: int, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """p-values (V,) of each variable: family-wise over all, and by itself.

    Blocks of the whitened residual (R, C) are permuted; ``block`` (R,) has the number of each row's
    block: a pose at rest, or a stretch of a motion.
    """
    order = orders(block, permutations, np.random.default_rng([seed, 30]))
    permuted = np.ascontiguousarray(np.moveaxis(residual[order], 2, 0).swapaxes(1, 2))
    # Wilson & Hilferty: the cube root of a χ² variable is nearly normal
    root = np.cbrt(parts.explained(parts.without_fitted(permuted)))
    spread = root.std(axis=1, keepdims=True)
    z = (root - root.mean(axis=1, keepdims=True)) / np.maximum(spread, 1e-9 * root.max() + 1e-300)
    together = (z.max(axis=0)[None] >= z[:, :1]).sum(axis=1)
    alone = (z >= z[:, :1]).sum(axis=1)
    return together / z.shape[1], alone / z.shape[1]


def shares(parts: Partitions, residual: np.ndarray, chosen: np.ndarray, gap: float) -> np.ndarray:
    """Shares (V,) of ``gap`` that each variable of mask ``chosen`` explains of a residual (R, C).

    Forward selection: each step takes the variable that explains most of the rest beyond what as
    many random columns would, and gives it only what earlier ones did not explain. ``gap`` is the
    mean square of a row's channel. Shares sum to at most 1; variables that add nothing have 0.
    """
    result = np.zeros(len(parts.names))
    y = parts.without_fitted(residual.T[:, :, None])[:, :, 0]  # (C, R)
    taken = np.zeros((*y.shape, 0))
    open_ = [int(k) for k in np.flatnonzero(chosen)]
    freedom, total = float(y.size), max(gap * y.size, 1e-300)
    while open_:
        gains = {}
        for k in open_:
            rest = parts.bases[k] - taken @ (np.swapaxes(taken, 1, 2) @ parts.bases[k])
            new = _orthonormal(rest, _DUPLICATE)
            size = int((np.abs(new).max(axis=1, initial=0.0) > 0.0).sum())
            explained = float(((np.swapaxes(new, 1, 2) @ y[:, :, None]) ** 2).sum())
            free = freedom - size
            if free > 0 and size:
                chance = (float((y**2).sum()) - explained) / free * size
                gains[k] = (explained - chance, new, size)
        best = max(gains, key=lambda k: gains[k][0], default=None)
        if best is None or gains[best][0] <= 0.0:
            break
        gain, new, size = gains[best]
        result[best] = min(gain / total, 1.0 - result.sum())
        y = y - (new @ (np.swapaxes(new, 1, 2) @ y[:, :, None]))[:, :, 0]
        taken = np.concatenate([taken, new], axis=2)
        freedom -= size
        open_.remove(best)
    return np.maximum(result, 0.0)


def _functions(prepared: Prepared) -> dict[str, np.ndarray]:
    """Functions of each variable at H observations: (H, k), or (C, H, k) if by channel."""
    scene, held = prepared.scene, prepared.scene.held
    known = variables(prepared)
    rotation = value(scene.pose[0])[held]
    down = scene.gravity @ rotation / np.linalg.norm(scene.gravity)
    across = rotation[:, :2].reshape(len(rotation), -1)
    wide = harmonics(down)
    result = {"orientation": np.concatenate([wide[:, :3], across, wide[:, 3:_DEGREE_2]], axis=1)}
    if "position" in known:
        place = known["position"]
        cell = (place[:, :3] > np.median(place[:, :3], axis=0)) @ (1, 2, 4)
        cells = (cell[:, None] == np.arange(7)).astype(float)
        result["position"] = np.concatenate([place, cells], axis=1)
    for j in range(len(scene.robot.joints)):
        turned, waves = _turned(prepared, j), known[f"joint {j + 1}"]
        both = [waves[:, i, None] * turned for i in range(2)]
        parts = [waves[:, :2], turned, waves[:, 2:4], *both, waves[:, 4:]]
        result[f"joint {j + 1}"] = np.concatenate(parts, axis=1)
        coming = scene.coming[held][:, j, None]
        if np.abs(coming).mean() > 0.2 and np.ptp(coming) > 1.0:
            ones = np.ones_like(coming)
            with_sign = coming * np.concatenate([ones, turned, down], axis=1)
            result[f"direction of joint {j + 1}"] = with_sign
    result |= {k: known[k] for k in ("time", "temperature") if k in known}
    load = prepared.expected / prepared.sigma
    if prepared.has_wrench:
        result |= _of_load(prepared, load)
    if isinstance(scene.q, Jet):
        rate = np.gradient(load, scene.period, axis=0)[held]
        # no single joint's speed or acceleration: in sums of sines they look like other angles
        pace = np.sqrt((scene.q.d**2).sum(axis=1))[held]
        shared = np.broadcast_to(np.stack([pace, pace**2], axis=1), (*rate.T.shape, 2))
        each = rate.T[:, :, None]
        result["speed"] = np.concatenate([each, np.abs(each), shared], axis=2)
    return result


def _of_load(prepared: Prepared, load: np.ndarray) -> dict[str, np.ndarray]:
    """Functions (C, H, k) of each channel's load (M, C), of |F|, |T|, and the load's direction."""
    held = prepared.scene.held
    scaled = load / np.maximum(np.abs(load).max(axis=0), 1e-9)
    x = scaled[held].T[:, :, None]
    step = np.diff(load, axis=0, prepend=load[:1])
    sign = held_on(np.where(np.abs(step) > 1e-6, np.sign(step), 0.0))[held].T[:, :, None]
    lengths = np.linalg.norm(prepared.expected[held].reshape(-1, 2, 3), axis=2)
    varied = lengths[:, np.ptp(lengths, axis=0) > 0.05 * lengths.max(axis=0)]
    bins = [(v > np.quantile(v, s)).astype(float) for v in varied.T for s in (0.25, 0.5, 0.75)]
    shared = np.broadcast_to(np.reshape(bins, (-1, x.shape[1])).T, (*x.shape[:2], len(bins)))
    return {
        "load": np.concatenate([x, x**2, np.abs(x), x**3, shared], axis=2),
        "direction of load": np.concatenate([sign, sign * np.abs(x), sign * x**2], axis=2),
    }


def _turned(prepared: Prepared, joint: int) -> np.ndarray:
    """Derivative (H, 3) of gravity's direction in sensor axes by ``joint``, from 0 [1/rad, 1/m]."""
    scene = prepared.scene
    q = scene.joints[scene.held]
    step = _TURN * np.eye(q.shape[1])[joint]
    up, down = (scene.robot.sensor_pose(q + s * step, scene.theta)[0] for s in (1, -1))
    change = scene.gravity @ (up - down) / np.linalg.norm(scene.gravity)
    return np.asarray(change / (2 * _TURN))


def _on_rows(prepared: Prepared, functions: np.ndarray) -> np.ndarray:
    if functions.ndim == 2:
        rows = prepared.averages(functions)
        return np.broadcast_to(rows, (len(prepared.variance), *rows.shape))
    rows = prepared.averages(np.moveaxis(functions, 0, 1).reshape(functions.shape[1], -1))
    return np.moveaxis(rows.reshape(len(rows), len(functions), -1), 1, 0)


def _orthonormal(columns: np.ndarray, tolerance: float = 0.0) -> np.ndarray:
    """Orthonormal basis (C, R, k') of the columns (C, R, k) of each channel, without a mean.

    Too many columns for the rows are cut; ``tolerance``: smallest norm of a direction; with 0,
    columns are scaled and cut first.
    """
    centred = columns - columns.mean(axis=1, keepdims=True)
    least = tolerance
    if tolerance == 0.0:
        centred = centred[:, :, : max(1, columns.shape[1] // SHARED_ROWS)]
        norm = np.sqrt((centred**2).sum(axis=1, keepdims=True))
        with_mean = np.sqrt((columns**2).sum(axis=1, keepdims=True))[:, :, : centred.shape[2]]
        norm = np.where(norm > _RANK * with_mean, norm, np.inf)
        centred, least = centred / norm, _RANK
    values, vectors = np.linalg.eigh(np.swapaxes(centred, 1, 2) @ centred)
    keep = values > least
    scale = np.where(keep, 1.0 / np.sqrt(np.where(keep, values, 1.0)), 0.0)
    basis = centred @ (vectors * scale[:, None, :])
    return np.asarray(basis[:, :, keep.any(axis=0)])


def _fitted(prepared: Prepared) -> np.ndarray:
    """Orthonormal basis (C R, k) of what every fit frees: bias, mass and CoG for a wrench, unknown
    numbers of the sensor for other channels."""
    columns = nuisance(prepared)
    if prepared.channels[0].weighs:  # alike at any mass above 0
        at = np.concatenate([[1.0], prepared.configuration.cog])
        columns = np.column_stack([columns, load_slopes(prepared, at)])
    if prepared.has_wrench:
        bias = np.eye(len(prepared.variance))
        columns = np.column_stack([columns, np.tile(bias, (len(columns) // len(bias), 1))])
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    return np.asarray(np.linalg.qr(columns / scale)[0])


def orders(block: np.ndarray, permutations: int, rng: np.random.Generator) -> np.ndarray:
    """Permuted row numbers (1 + permutations, R), the first row in original order, for rows with
    block numbers ``block`` (R,).

    Rows of a motion are shifted in a circle, cut into stretches of one block's length, permuted.
    """
    rows = len(block)
    length = max(1, rows // len(np.unique(block)))
    count = -(-rows // length)
    number = np.arange(rows)
    result = np.empty((permutations + 1, rows), dtype=int)
    result[0] = number
    for k in range(1, permutations + 1):
        place = rng.permutation(count)[number // length] * rows + number % length
        shift = int(rng.integers(rows)) if length > 1 else 0
        result[k] = (np.argsort(place, kind="stable") + shift) % rows
    return result
