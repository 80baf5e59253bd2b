"""The dictionary: columns that every effect, and a flexible unknown, would add to each reading.

All columns are linear responses at the baseline (simulator after the fit of bias, mass and CoG),
whitened; a coefficient is in units of its parameter's typical size. Evidence needs their Gram
matrix alone. The flexible unknown has one group of columns (kernel) per variable that a residual
may depend on: smooth functions, channel by channel, which fit what no effect of the library makes.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product

import numpy as np

from wrenchbed.channels.base import flat
from wrenchbed.channels.own_noise import orthonormal
from wrenchbed.channels.readings_with_effects import Response
from wrenchbed.diagnosis.prepare.configured_simulator import STATED
from wrenchbed.diagnosis.prepare.prepared import Prepared
from wrenchbed.effects.base import Effect, Residual, Variant
from wrenchbed.effects.chain import effects
from wrenchbed.effects.drives.operators import lagging
from wrenchbed.physics.model_parameters import Parameter
from wrenchbed.physics.rotations import cross
from wrenchbed.physics.taylor_jets import Jet, value
from wrenchbed.physics.wrench import CHANNELS

TIME_WAVES = 8
"""Number of cosines, of 1, 2, … half periods over the recording, that model a drift in time."""
FLOW_S = (10.0, 40.0)
"""Time constants [s] with which a flowing load follows the orientation: one pose to several."""
LARGEST = 30.0
"""Largest size of an effect, in typical sizes; an effect that is invisible then is left out."""
VISIBLE = 0.5
"""Least gap that an effect of size `LARGEST` must add; effects that add less are left out."""
_Shape = tuple[tuple[str, float], ...]


def features(prepared: Prepared) -> dict[str, np.ndarray]:
    """Smooth functions as columns (C R, k), R rows of C channels, by variable; gap 1 a variable."""
    groups: dict[str, np.ndarray] = {}
    for name, base in variables(prepared).items():
        groups[name] = np.kron(prepared.averages(base), np.eye(len(prepared.variance)))
    if prepared.has_wrench and not prepared.scene.sampled:
        groups["earlier orientations"] = _flowing(prepared)
    seen = {name: block[:, np.abs(block).max(axis=0) > 1e-9] for name, block in groups.items()}
    return {
        name: block / np.sqrt((block**2).sum() / len(block))
        for name, block in seen.items()
        if block.shape[1]
    }


def _flowing(prepared: Prepared) -> np.ndarray:
    """Columns (C R, k) of a tool whose CoG follows earlier orientations, as a thick liquid."""
    scene, of = prepared.scene, prepared.families[0]
    force = scene.tool_force(scene.load)
    down = force / np.maximum(np.linalg.norm(force, axis=1, keepdims=True), 1e-9)
    columns = list[np.ndarray]()
    for tau in FLOW_S:
        late = lagging(down, scene.t, tau)
        shapes = [*late.T, *(late[:, i] * late[:, j] for i in range(3) for j in range(i, 3))]
        for shape, axis in product(shapes, np.eye(3)):
            reading = np.zeros((len(scene), len(prepared.variance)))
            reading[:, of][:, 3:] = cross(shape[:, None] * axis, force)
            columns.append(prepared.rows(reading).ravel())
    return np.stack(columns, axis=1)


def variables(prepared: Prepared) -> dict[str, np.ndarray]:
    """Functions (H, k) of each variable (orientation, time …) at the H observations, by name."""
    scene, held = prepared.scene, prepared.scene.held
    rotation, position = (value(x) for x in scene.pose)
    result: dict[str, np.ndarray] = {}
    down = scene.gravity @ rotation[held] / np.linalg.norm(scene.gravity)
    result["orientation"] = harmonics(down)
    if scene.jointed:
        at = np.broadcast_to(position, (len(scene), 3))[held]
        at = (at - at.mean(axis=0)) / np.maximum(at.std(axis=0), 1e-3)
        squares = [at[:, i] * at[:, j] for i in range(3) for j in range(i, 3)]
        result["position"] = np.stack([*at.T, *squares], axis=1)
        q = prepared.poses
        for j, joint in enumerate(scene.robot.joints, start=1):
            result[f"joint {j}"] = _of_joint(q[:, j - 1], joint.unit == "rad")
        coming = scene.coming[held]
        if np.abs(coming).any():
            result["direction"] = coming[:, np.abs(coming).mean(axis=0) > 0.2]
    age = scene.age[held] / scene.span
    result["time"] = np.cos(np.pi * np.arange(1, TIME_WAVES + 1) * age[:, None])
    if scene.warmth is not None and np.ptp(scene.warmth) > 0.1:
        warm = scene.warmth[held] / np.abs(scene.warmth).max()
        result["temperature"] = np.stack([warm, warm**2], axis=1)
    if isinstance(scene.q, Jet):
        speed = np.concatenate([scene.q.d, scene.q.dd], axis=1)
        result["speed"] = speed / np.maximum(speed.std(axis=0), 1e-9)
    return {k: v for k, v in result.items() if v.shape[1]}


def harmonics(down: np.ndarray) -> np.ndarray:
    """Real harmonic polynomials of degree 1 to 4 of unit vectors (H, 3) → (H, 24), orthogonalised
    over the sphere by their recursion."""
    x, y, z = down.T
    return np.stack(
        [
            x, y, z,
            x * y, y * z, x * z, x**2 - y**2, 3 * z**2 - 1,
            x * y * z, z * (x**2 - y**2), x * (5 * z**2 - 1), y * (5 * z**2 - 1),
            z * (5 * z**2 - 3), x * (x**2 - 3 * y**2), y * (3 * x**2 - y**2),
            x * y * (x**2 - y**2), z * x * (x**2 - 3 * y**2), z * y * (3 * x**2 - y**2),
            (x**2 - y**2) * (7 * z**2 - 1), x * y * (7 * z**2 - 1), x * z * (7 * z**2 - 3),
            y * z * (7 * z**2 - 3), 35 * z**4 - 30 * z**2 + 3,
            x**4 - 6 * x**2 * y**2 + y**4,
        ],
        axis=1,
    )  # fmt: skip


def _of_joint(q: np.ndarray, turns: bool) -> np.ndarray:
    if turns:
        return np.stack([f(k * q) for k in (1, 2, 3) for f in (np.sin, np.cos)], axis=1)
    x = (q - q.mean()) / max(float(q.std()), 1e-3)
    return np.stack([x, x**2, x**3], axis=1)


@dataclass(frozen=True)
class Hypothesis:
    """One variant of one effect: indices of its columns (k,), and its gap at typical size."""

    effect: Effect
    variant: Variant
    columns: np.ndarray
    typical_gap: float

    @property
    def name(self) -> str:
        return self.effect.name


@dataclass(frozen=True, eq=False)
class EffectDictionary:
    """Columns of all effects for one design (poses, noise), at R rows of C measured columns, from
    one baseline: the simulator after the fit of bias, mass and CoG.

    Attributes:
        prepared: the design and its noise, with the scene at the baseline's parameters.
        baseline: whitened readings that the baseline predicts (C R,), row by row.
        E: whitened change of the readings per typical size of each parameter (C R, n).
        size: typical size of each column's parameter (n,), SI.
        label: (effect, parameter) of each column, or (variable, '') of a smooth function.
        hypotheses: variants of effects that may be claimed; ``invisible``: names of the others.
        kernels: indices of smooth functions' columns, by the variable that they depend on.
        stated: indices of the numbers that every user fits; ``tolerance`` in typical sizes.
        nuisance: indices of columns of unknown numbers of sensors, which every fit frees.
        imperfections: indices of columns of imperfections of healthy sensors.
        of_all: the dictionary of all rows, if this one leaves a fold out.
        free_form: indices of columns that only variants without a formula have.
    """

    prepared: Prepared
    baseline: np.ndarray
    E: np.ndarray
    size: np.ndarray
    label: tuple[tuple[str, str], ...]
    hypotheses: tuple[Hypothesis, ...]
    kernels: Mapping[str, np.ndarray]
    stated: np.ndarray
    tolerance: np.ndarray
    invisible: tuple[str, ...]
    of_all: "EffectDictionary | None" = None
    free_form: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))
    nuisance: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))
    imperfections: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))

    @property
    def channels(self) -> int:
        """Number C of measured columns, all channels together."""
        return len(self.prepared.variance)

    @cached_property
    def grams(self) -> np.ndarray:
        """Gram matrix EᵀE of the rows of each measured column (C, n, n)."""
        n = self.E.shape[1]
        result = np.empty((self.channels, n, n))
        rows = np.swapaxes(self.E.reshape(-1, self.channels, n), 0, 1)
        for c, of_channel in enumerate(rows):
            np.matmul(of_channel.T, of_channel, out=result[c])
        return result

    @cached_property
    def _weighed(self) -> dict[tuple[float, ...], np.ndarray]:
        return {}

    def weighed(self, weights: np.ndarray) -> np.ndarray:
        """Weighted Gram matrix Eᵀ W E (n, n) for weights (C,) of the measured columns."""
        key = tuple(weights.tolist())
        if key not in self._weighed:
            if self.of_all is None:
                self._weighed[key] = np.tensordot(weights, self.grams, 1)
            else:
                held_out = self.of_all.prepared.fold_rows == self.prepared.held_out
                root = np.tile(np.sqrt(weights), np.count_nonzero(held_out))
                part = self.of_all.E[np.repeat(held_out, self.channels)] * root[:, None]
                self._weighed[key] = self.of_all.weighed(weights) - part.T @ part
        return self._weighed[key]

    def weighed_by(self, noise: np.ndarray) -> np.ndarray:
        """Gram matrix Eᵀ v₀⁻¹ E (n, n) of columns E, for a ``noise`` variance v₀ (C R,) the same
        in all rows of a measured column."""
        return self.weighed(1.0 / noise[: self.channels])

    @property
    def rows(self) -> int:
        return len(self.E) // self.channels

    @cached_property
    def always(self) -> np.ndarray:
        """Indices of the columns that every fit frees: `nuisance`, then the stated numbers."""
        return np.concatenate([self.nuisance, self.stated])

    @cached_property
    def fitted_away(self) -> np.ndarray:
        """Orthonormal basis (C R, S) of the S columns that every fit frees, each in one channel."""
        return np.linalg.qr(self.E[:, self.always])[0]

    def mean_square(self, x: np.ndarray) -> np.ndarray:
        """Mean square (F, …) of whitened signals (C R, …) over rows and columns of each channel."""
        rows = x.reshape(-1, self.channels, *x.shape[1:])
        of = (rows[:, f] for f in self.prepared.families)
        squares = [np.einsum("rc...,rc...->...", y, y) / (y.shape[0] * y.shape[1]) for y in of]
        return np.stack(squares)

    def gap(self, signal: np.ndarray, *, configured: bool = False) -> float:
        """Gap of a whitened signal (C R,): after the fit of bias, mass and CoG, or before it if
        ``configured``."""
        if not configured:
            signal = self.without_stated(signal)
        return float(self.mean_square(signal).sum())

    def gaps(self, signal: np.ndarray) -> np.ndarray:
        """Gap (F,) of a whitened signal (C R,) in each channel after the fit of bias, mass, CoG; of
        the first by the correlation of its columns' noise, as published gaps, if that is more."""
        left, of = self.without_stated(signal), self.prepared.families[0]
        each = self.mean_square(left)
        white = left.reshape(-1, self.channels)[:, of] @ self._root.T
        each[0] = max(each[0], np.mean(white**2))
        return np.asarray(each - self.channel_noise)

    @cached_property
    def _root(self) -> np.ndarray:
        """Inverse root (c, c) of the correlation of the noise in the first channel's c columns."""
        covariance = self.prepared.leading.covariance
        std = np.sqrt(np.diagonal(covariance))
        return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance / np.outer(std, std))))

    @cached_property
    def configured_gap(self) -> np.ndarray:
        """Gap that each of n columns adds at its parameter's typical size (n,), before any fit."""
        return np.asarray(self.gap_of_channel.sum(axis=0))

    @cached_property
    def gap_of_channel(self) -> np.ndarray:
        """Gap of each of n columns in each of F channels (F, n) at typical size, before any fit."""
        return self.mean_square(self.E)

    @cached_property
    def column_gap(self) -> np.ndarray:
        """Gap (n,) of each column at typical size after bias, mass and CoG are fitted."""
        taken = (self.fitted_away.T @ self.E) ** 2
        of_channel = self.mean_square(self.fitted_away).sum(axis=0)  # of unit vectors
        return np.asarray(np.maximum(self.configured_gap - of_channel @ taken, 0.0))

    def of_stated(self, effect: str) -> np.ndarray:
        """Whether each of S columns of bias, mass and CoG belongs to ``effect`` (S,), boolean."""
        return np.array([self.label[k][0] == effect for k in self.stated], dtype=bool)

    def fitted(self, signal: np.ndarray, rows: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Least-squares fit of the S stated numbers (bias, mass, CoG), in typical sizes (S,), to
        those values of a whitened signal (C R,) that ``rows`` selects."""
        columns = self.E[:, self.stated][rows]
        return np.asarray(np.linalg.lstsq(columns, signal[rows], rcond=None)[0])

    def without_stated(self, signal: np.ndarray) -> np.ndarray:
        """Remove from a signal (C R, …) its least-squares fit by bias, mass and CoG."""
        return np.asarray(signal - self.fitted_away @ (self.fitted_away.T @ signal))

    def without(self, fold: int) -> "EffectDictionary":
        """Dictionary of the same columns on the rows outside the fold of number ``fold``."""
        keep = np.repeat(self.prepared.fold_rows != fold, self.channels)
        return replace(
            self,
            prepared=self.prepared.without(fold),
            baseline=self.baseline[keep],
            E=self.E[keep],
            of_all=self,
        )

    @property
    def row_noise(self) -> float:
        """Noise of the averaged rows that are fitted, as a gap, summed over all channels."""
        return float(self.channel_noise.sum())

    @property
    def channel_noise(self) -> np.ndarray:
        """Noise of the averaged rows that are fitted, as a gap, in each channel (F,)."""
        return np.array([self.prepared.variance[f].mean() for f in self.prepared.families])

    @cached_property
    def _of_effects(self) -> Mapping[str, np.ndarray]:
        """Column indices of each effect, all variants together, by name in order."""
        columns: dict[str, list[int]] = {}
        for k, (effect, parameter) in enumerate(self.label):
            if parameter:
                columns.setdefault(effect, []).append(k)
        return {effect: np.array(columns[effect]) for effect in sorted(columns)}

    @cached_property
    def imperfect(self) -> Mapping[str, np.ndarray]:
        """Column indices, by effect, of small imperfections of any robot: no variants with a free
        curve (smooth functions stand for them), no stated numbers (they have tolerances)."""
        stated = {self.label[k][0] for k in self.stated}
        columns = {e: np.setdiff1d(k, self.free_form) for e, k in self._of_effects.items()}
        return {e: k for e, k in columns.items() if e not in stated}

    def of_effect(self, name: str) -> np.ndarray:
        """Column indices of an effect, all variants together; empty if it has none."""
        return self._of_effects.get(name, np.zeros(0, dtype=int))


def build(
    prepared: Prepared, robot_theta: np.ndarray, tolerance: Mapping[str, np.ndarray]
) -> EffectDictionary:
    """Make the columns of all effects (change of readings per typical size) at a baseline, with
    parameters (P,) of the robot and its tool; ``tolerance`` of bias, mass and CoG by effect, SI;
    inf if they are not stated."""
    at = prepared.at(robot_theta)
    response = Response(at.scene, at.channels)
    residual = FittedResidual(at.leading, response, tolerance)
    away, lacking = nuisance(at), _of_channels(at, [c.imperfections(at.scene) for c in at.channels])
    columns: list[np.ndarray] = [*away.T, *lacking.T]
    first, size = len(columns), [1.0] * len(columns)
    label: list[tuple[str, str]] = [("sensor", "")] * first
    index: dict[tuple[str, str, _Shape], int] = {}
    drafts: list[tuple[Effect, Variant, list[int]]] = []
    formula: set[int] = set()
    for effect in effects().values():
        if not at.reads(effect):
            continue
        known = {p.name: p for p in effect.parameters(at.robot)}
        named = (*effect.variants(at.scene), *residual.suggests(effect))
        every = (*named, *effect.free_forms(at.scene))
        made = _columns(prepared, response, effect, every)
        for k, variant in enumerate(every):
            chosen, shape = [], _shape(variant)
            for name in variant.free:
                key = (effect.name, name, shape)
                if key not in index:
                    index[key] = len(columns)
                    columns.append(made[key[1:]])
                    size.append(known[name].tolerance)
                    label.append((effect.name, name))
                chosen.append(index[key])
            formula |= set(chosen) if k < len(named) else set()
            drafts.append((effect, variant, chosen))
    free_form = np.array([k for k in range(first, len(columns)) if k not in formula], dtype=int)
    stated = np.array([k for k, (e, _) in enumerate(label) if e in tolerance], dtype=int)
    basis = np.linalg.qr(np.column_stack([away, *(columns[k] for k in stated)]))[0]
    kernels: dict[str, np.ndarray] = {}
    for kernel, full in features(at).items():
        block = full - basis @ (basis.T @ full)  # what every user fits is nothing unknown
        kernels[kernel] = len(columns) + np.arange(block.shape[1])
        columns.extend(block.T)
        size.extend([1.0] * block.shape[1])
        label.extend([(kernel, "")] * block.shape[1])
    in_order = dict.fromkeys(label[k][0] for k in stated)
    allowed = np.concatenate([np.zeros(0), *(np.atleast_1d(tolerance[e]) for e in in_order)])
    draft = EffectDictionary(
        prepared=at,
        baseline=prepared.rows(at.expected).ravel(),
        E=np.stack(columns, axis=1),
        size=np.array(size),
        label=tuple(label),
        hypotheses=(),
        kernels=kernels,
        stated=stated,
        tolerance=allowed / np.array(size)[stated],
        invisible=(),
        free_form=free_form,
        nuisance=np.arange(away.shape[1]),
        imperfections=np.arange(away.shape[1], first),
    )
    return _with_hypotheses(draft, drafts)


def nuisance(prepared: Prepared) -> np.ndarray:
    """Columns (C R, k) of unknown numbers of all sensors, orthogonal, with mean square 1."""
    slopes = [c.nuisance(prepared.scene) for c in prepared.channels]
    block = orthonormal(_of_channels(prepared, slopes))
    return np.asarray(block * np.sqrt(len(block)))


def _of_channels(prepared: Prepared, each: Sequence[np.ndarray]) -> np.ndarray:
    """Whitened columns (C R, k): each channel's derivatives (M, c, n) by n numbers, 0 elsewhere."""
    width, result = prepared.families[-1].stop, list[np.ndarray]()
    for slopes, of in zip(each, prepared.families, strict=True):
        for slope in np.moveaxis(slopes, 2, 0):
            every = np.zeros((len(slope), width))
            every[:, of] = slope
            result.append(prepared.rows(every).ravel())
    rows = len(prepared.block_rows) * width
    return np.stack(result, axis=1) if result else np.zeros((rows, 0))


def _shape(variant: Variant) -> _Shape:
    """Shape parameters (a filter's time, an angle …) of an effect's variant, as sorted pairs."""
    return tuple(sorted(variant.at.items()))


def _columns(
    prepared: Prepared, response: Response, effect: Effect, variants: Sequence[Variant]
) -> dict[tuple[str, _Shape], np.ndarray]:
    """Whitened columns (C R,) of an effect's variants by name of amplitude and shape parameters."""
    known = {p.name: p for p in effect.parameters(response.scene.robot)}
    wanted: dict[_Shape, dict[str, Parameter]] = {}
    for variant in variants:
        of_shape = wanted.setdefault(_shape(variant), {})
        of_shape |= {name: known[name] for name in variant.free}
    result = {}
    for shape, parameters in wanted.items():
        for names, change in response.changes(effect, [*parameters.values()], dict(shape)):
            rows = prepared.rows(change)
            if len(names) == 1:
                result[names[0], shape] = rows.ravel()
                continue
            for name in names:
                channel = CHANNELS.index(name.rpartition(".")[2])
                alone = np.zeros_like(rows)
                alone[:, channel] = rows[:, channel]
                result[name, shape] = alone.ravel()
    return result


def _with_hypotheses(
    draft: EffectDictionary, drafts: list[tuple[Effect, Variant, list[int]]]
) -> EffectDictionary:
    kept: list[Hypothesis] = []
    free = {draft.label[k][0] for k in draft.stated[np.isinf(draft.tolerance)]}
    for effect, variant, chosen in drafts:
        if effect.name in free:  # nothing is stated: nothing can be wrong
            continue
        gap = draft.configured_gap if effect.stated else draft.column_gap
        typical = float(gap[chosen].sum())
        if typical * LARGEST**2 >= VISIBLE:
            kept.append(Hypothesis(effect, variant, np.array(chosen), typical))
    invisible = {e.name for e, _, _ in drafts} - {h.name for h in kept} - free
    return replace(draft, hypotheses=tuple(kept), invisible=tuple(sorted(invisible)))


class FittedResidual:
    """Residual of the first channel after the fit of bias, mass and CoG, for effects to scan."""

    def __init__(self, prepared: Prepared, response: Response, stated: Collection[str]) -> None:
        alone = Response(prepared.scene, prepared.channels)
        one = response.channels == prepared.channels
        self.scene, self.response = prepared.scene, response if one else alone
        self._rows = np.flatnonzero(prepared.scene.held)[prepared.fitted]
        self._noise = prepared.sigma
        measured = (prepared.residual[prepared.fitted] / self._noise).ravel()
        columns = [
            self.response.tangent(e, p, Variant(e.name, (p.name,)))[self._rows] / self._noise
            for e in (effects()[n] for n in STATED if n in stated)
            for p in e.parameters(self.scene.robot)
        ]
        away = flat(prepared.channels[0].nuisance(self.scene)[self._rows] / self._noise[:, None])
        fitted = np.column_stack([orthonormal(away), *(c.ravel() for c in columns)])
        basis = np.linalg.qr(fitted)[0]
        self._value = (measured - basis @ (basis.T @ measured)).reshape(-1, len(self._noise))
        self._fitted = basis.reshape(*self._value.shape, -1)

    def suggests(self, effect: Effect) -> tuple[Variant, ...]:
        """Variants, with shape parameters, that an effect's scan of the residual suggests."""
        known = {p.name: p for p in effect.parameters(self.scene.robot)}

        def tangent(name: str, at: Mapping[str, float]) -> np.ndarray:
            return self.response.tangent(effect, known[name], Variant(effect.name, (name,), at))

        residual = Residual(self._rows, self._value, self._noise, tangent, self._fitted)
        return effect.scan(self.scene, residual)
