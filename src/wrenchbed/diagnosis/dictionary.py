"""The dictionary: what every effect, and a flexible unknown, would add to each reading.

All columns are linear responses at the baseline, whitened; a column's coefficient is in units of
the parameter's typical size. The Gram matrix of these columns is all that the evidence needs.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wrenchbed.chain import Active, acts, effects, respond
from wrenchbed.diagnosis.features import features
from wrenchbed.diagnosis.prepare import Prepared
from wrenchbed.effects.base import (
    Effect,
    LoadEffect,
    ModelEffect,
    Pose,
    ReadingEffect,
    Residual,
    Variant,
)
from wrenchbed.parameters import Parameter
from wrenchbed.scene import Scene

STATED = ("sensor.bias", "tool.mass", "tool.cog")
"""Effects that are wrong numbers in the metadata: every user fits them."""
LARGEST = 30.0
"""An effect may be so many times its typical size; what stays invisible then is not considered."""
VISIBLE = 0.5
"""Gap that an effect must be able to add to be considered at all."""


@dataclass(frozen=True)
class Hypothesis:
    """One variant of one effect: its columns (k,), the gap that it adds at typical size."""

    effect: Effect
    variant: Variant
    columns: np.ndarray
    typical_gap: float

    @property
    def name(self) -> str:
        return self.effect.name


@dataclass(frozen=True, eq=False)
class Dictionary:
    """Columns of one design at one baseline.

    Attributes:
        prepared: the design and the noise, its scene at the baseline's parameters.
        baseline: readings there (6 R,), whitened.
        E: columns (6 R, n).
        size: typical size of each column's parameter (n,), SI.
        label: (effect, parameter) of each column, or (kernel, '') of a feature.
        hypotheses: what may be claimed.
        kernels: columns of the flexible unknown by the variable that they depend on.
        stated: columns of the numbers that every user fits, and their tolerances in typical sizes.
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

    @cached_property
    def gram(self) -> np.ndarray:
        """EᵀE (n, n)."""
        return self.E.T @ self.E

    @cached_property
    def grams(self) -> np.ndarray | None:
        """EᵀE of each channel's rows (6, n, n); None where there are fewer rows than columns."""
        if len(self.E) <= self.E.shape[1]:
            return None
        channels = self.E.reshape(-1, 6, self.E.shape[1])
        return np.stack([channels[:, c].T @ channels[:, c] for c in range(6)])

    @property
    def rows(self) -> int:
        return len(self.E) // 6

    @cached_property
    def fitted_away(self) -> np.ndarray:
        """Orthonormal basis of what a fit of bias, mass and CoG takes from any signal (6 R, 10)."""
        return np.linalg.qr(self.E[:, self.stated])[0]

    def gap(self, signal: np.ndarray, *, configured: bool = False) -> float:
        """Gap of a signal (6 R,), after that fit unless it counts as configured."""
        if not configured:
            signal = signal - self.fitted_away @ (self.fitted_away.T @ signal)
        return float((signal**2).mean())

    @cached_property
    def configured_gap(self) -> np.ndarray:
        """Gap of each column at typical size (n,)."""
        return np.asarray((self.E**2).mean(axis=0))

    @cached_property
    def column_gap(self) -> np.ndarray:
        """Gap of each column at typical size after bias, mass and CoG are fitted (n,)."""
        left = (self.E**2).sum(axis=0) - ((self.fitted_away.T @ self.E) ** 2).sum(axis=0)
        return np.asarray(np.maximum(left, 0.0) / self.E.shape[0])

    def of_effect(self, name: str) -> np.ndarray:
        """Distinct columns of an effect, whatever the variant."""
        return np.array([k for k, (e, p) in enumerate(self.label) if e == name and p], dtype=int)


def build(prepared: Prepared, theta: np.ndarray, tolerance: Mapping[str, np.ndarray]) -> Dictionary:
    """All columns at a baseline.

    Args:
        prepared: the design.
        theta: full parameters of the baseline (P,).
        tolerance: of the stated numbers by effect, SI; inf where nothing is stated.
    """
    at = prepared.at(theta)
    response = Response(at.scene)
    left = Leftover(at, response)
    columns: list[np.ndarray] = []
    size: list[float] = []
    label: list[tuple[str, str]] = []
    index: dict[tuple[str, str, tuple[tuple[str, float], ...]], int] = {}
    drafts: list[tuple[Effect, Variant, list[int]]] = []
    for effect in effects().values():
        if not acts(effect, at.scene):
            continue
        known = effect.parameters(at.scene.robot)
        for variant in (*effect.variants(at.scene), *left.suggests(effect)):
            chosen = []
            for name in variant.free:
                key = (effect.name, name, tuple(sorted(variant.at.items())))
                if key not in index:
                    parameter = known[known.index(name)]
                    index[key] = len(columns)
                    columns.append(
                        prepared.rows(response.tangent(effect, parameter, variant)).ravel()
                    )
                    size.append(parameter.tolerance)
                    label.append((effect.name, name))
                chosen.append(index[key])
            drafts.append((effect, variant, chosen))
    stated = np.array([k for k, (e, _) in enumerate(label) if e in STATED])
    basis = np.linalg.qr(np.stack([columns[k] for k in stated], axis=1))[0]
    kernels: dict[str, np.ndarray] = {}
    for kernel, full in features(at).items():
        block = full - basis @ (basis.T @ full)  # what every user fits is nothing unknown
        kernels[kernel] = len(columns) + np.arange(block.shape[1])
        columns.extend(block.T)
        size.extend([1.0] * block.shape[1])
        label.extend([(kernel, "")] * block.shape[1])
    wide = np.concatenate([np.atleast_1d(tolerance[e]) for e in _in_order(label, stated)])
    draft = Dictionary(
        prepared=at,
        baseline=prepared.rows(response.reading).ravel(),
        E=np.stack(columns, axis=1),
        size=np.array(size),
        label=tuple(label),
        hypotheses=(),
        kernels=kernels,
        stated=stated,
        tolerance=wide / np.array(size)[stated],
        invisible=(),
    )
    return _with_hypotheses(draft, drafts)


def _in_order(label: list[tuple[str, str]], stated: np.ndarray) -> list[str]:
    seen: list[str] = []
    for k in stated:
        if label[k][0] not in seen:
            seen.append(label[k][0])
    return seen


def _with_hypotheses(
    draft: Dictionary, drafts: list[tuple[Effect, Variant, list[int]]]
) -> Dictionary:
    gap = draft.column_gap
    own = draft.configured_gap
    kept: list[Hypothesis] = []
    shown: set[str] = set()
    free = {draft.label[k][0] for k in draft.stated[np.isinf(draft.tolerance)]}
    for effect, variant, chosen in drafts:
        if effect.name in free:  # nothing is stated: nothing can be wrong
            continue
        counted = own if effect.name in STATED else gap
        typical = float(counted[chosen].sum())
        if typical * LARGEST**2 >= VISIBLE:
            kept.append(Hypothesis(effect, variant, np.array(chosen), typical))
            shown.add(effect.name)
    invisible = sorted({e.name for e, _, _ in drafts} - shown - free)
    values = {f: getattr(draft, f) for f in draft.__dataclass_fields__}
    return Dictionary(**values | {"hypotheses": tuple(kept), "invisible": tuple(invisible)})


class Leftover:
    """What is left of a recording after bias, mass and CoG, for effects to look through."""

    def __init__(self, prepared: Prepared, response: "Response") -> None:
        self.scene, self.response = prepared.scene, response
        self._rows = np.flatnonzero(prepared.scene.held)[~prepared.sealed]
        noise = 1.0 / np.diagonal(prepared.turn)
        whole = (prepared.y - response.reading[prepared.scene.held])[~prepared.sealed] / noise
        stated = [
            response.tangent(e, p, Variant(e.name, (p.name,)))[self._rows] / noise
            for e in (effects()[n] for n in STATED)
            for p in e.parameters(self.scene.robot)
        ]
        basis = np.linalg.qr(np.stack([c.ravel() for c in stated], axis=1))[0]
        value = whole.ravel() - basis @ (basis.T @ whole.ravel())
        self._value, self._noise = value.reshape(-1, 6), noise

    def suggests(self, effect: Effect) -> tuple[Variant, ...]:
        """Variants that a scan of the residual suggests."""
        known = {p.name: p for p in effect.parameters(self.scene.robot)}

        def tangent(name: str, at: Mapping[str, float]) -> np.ndarray:
            return self.response.tangent(effect, known[name], Variant(effect.name, (name,), at))

        return effect.found(self.scene, Residual(self._rows, self._value, self._noise, tangent))


class Response:
    """Readings of a scene and how they change with one amplitude of one effect."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.reading = respond(scene)
        self._pose = Pose(*scene.pose)

    def tangent(self, effect: Effect, parameter: Parameter, variant: Variant) -> np.ndarray:
        """Change of all readings (M, 6) per typical size, by central differences."""
        start = {p.name: p.nominal for p in effect.parameters(self.scene.robot)} | dict(variant.at)
        half = 0.5 * parameter.tolerance
        up = self._with(effect, start | {parameter.name: half})
        down = self._with(effect, start | {parameter.name: -half})
        return up - down

    def _with(self, effect: Effect, values: Mapping[str, float]) -> np.ndarray:
        if isinstance(effect, ReadingEffect):
            return effect.read(self.scene, self.reading, values)
        if isinstance(effect, LoadEffect) and not isinstance(effect, ModelEffect):
            return effect.load(self.scene, self._pose, self.scene.load, values)
        return respond(self.scene, [Active(effect, values)])
