"""A diagnosis whose answer is known by hand: orthogonal columns, a linear robot, white noise.

Every column has a gap that is stated here, so an effect of amplitude a (in typical sizes) adds
a gap of a² times that. Noise has a variance of 1 in each reading.
"""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np

from wrenchbed import registry
from wrenchbed.diagnosis.evidence.dictionary import EffectDictionary, Hypothesis
from wrenchbed.diagnosis.evidence.search import Searcher
from wrenchbed.diagnosis.explain.finalist import Variables
from wrenchbed.diagnosis.explain.refit import Refitter
from wrenchbed.effects.base import Effect, Variant

STATED = [("sensor.bias", c) for c in "fx fy fz tx ty tz".split()]
STATED += [("tool.mass", "mass"), *(("tool.cog", c) for c in "xyz")]
ROWS = 60
"""Poses, of six readings each."""


class Other(Effect):
    """An effect that declares nothing."""

    family = subsystem = "other"


@dataclass(frozen=True)
class Named:
    """An effect as far as the linear analysis asks for it."""

    name: str
    form_error: float = 0.06
    rough: bool = False
    stage: str = "reading"

    def __getattr__(self, declared: str):
        """What the effect of that name declares; the defaults where there is none."""
        known = self.name in registry.names("effects")
        return getattr(registry.load("effects", self.name) if known else Other, declared)


class LinearRefitter(Refitter):
    """Refits structures whose response is linear in their amplitudes."""

    def response(self, parts, x):
        v = Variables(parts)
        columns = [self._column(parts[k], name) for k, name in zip(v.part, v.name, strict=True)]
        return np.stack(columns, axis=1) @ x if columns else np.zeros(len(self.y))

    def _column(self, h, name):
        return self.d.E[:, h.columns[h.variant.free.index(name)]]


@dataclass(frozen=True, eq=False)
class Design:
    """Rows of a fit, in blocks of five poses and four folds, as far as a dictionary asks."""

    block_rows: np.ndarray
    fold_rows: np.ndarray
    moving: bool = False
    held_out: int | None = None
    stride: int = 1
    variance = np.ones(6)
    channels = ()
    families = (slice(0, 6),)
    leading = SimpleNamespace(covariance=np.eye(6))
    scene = SimpleNamespace(robot=None, period=0.008)

    def without(self, fold):
        keep = self.fold_rows != fold
        return replace(
            self, block_rows=self.block_rows[keep], fold_rows=self.fold_rows[keep], held_out=fold
        )


EFFECTS = {
    "base.tilt": 2, "joint.offset": 1, "joint.backlash": 1, "link.length": 1, "cable.pull": 2,
    "sensor.temperature": 1, "tool.loose": 1, "timing.delay": 1,
}  # fmt: skip
"""Effects and their numbers of columns."""
KERNELS = {"time": 4, "pose": 5}


def basis(count, rows=ROWS, seed=0):
    """Orthonormal columns (6 R, count); the first six are constant in one channel each."""
    start = np.random.default_rng(seed).standard_normal((6 * rows, count))
    start[:, :6] = np.tile(np.eye(6), (rows, 1))
    whole = np.linalg.qr(start)[0]
    return whole * np.sign((whole * start).sum(axis=0))


def dictionary(effects=EFFECTS, alike=None, gap=4.0, tolerance=0.3, rows=ROWS, moving=False):
    """A dictionary of orthogonal columns.

    Args:
        effects: number of columns by name.
        alike: correlation of the first column of one name with that of another, which changes.
        gap: that a column adds at its typical size.
        tolerance: of stated numbers, in typical sizes.
    """
    names = ((e, e.partition(".")[2], n) for e, n in effects.items())
    label = [*STATED, *((e, f"{stem}.{k}") for e, stem, n in names for k in range(n))]
    kernels, label_of_kernels = {}, []
    for kernel, n in KERNELS.items():
        kernels[kernel] = len(label) + len(label_of_kernels) + np.arange(n)
        label_of_kernels += [(kernel, "")] * n
    label += label_of_kernels
    E = basis(len(label), rows) * np.sqrt(6 * rows * gap)
    E[:, len(label) - len(label_of_kernels) :] /= np.sqrt(gap)
    first = {e: k for k, (e, _) in reversed([*enumerate(label)])}
    for (one, other), r in (alike or {}).items():
        a, b = E[:, first[one]].copy(), E[:, first[other]]
        E[:, first[other]] = r * a + np.sqrt(1.0 - r**2) * b
    prepared = Design(np.arange(rows) // 5, np.arange(rows) // 5 % 4, moving)
    d = EffectDictionary(
        prepared, np.zeros(6 * rows), E, np.ones(len(label)), tuple(label), (), kernels,
        np.arange(10), np.full(10, tolerance), (),
    )  # fmt: skip
    hypotheses = []
    for e, n in {"sensor.bias": 6, "tool.mass": 1, "tool.cog": 3, **effects}.items():
        columns = np.array([k for k, (name, _) in enumerate(label) if name == e])
        free = tuple(p for name, p in label if name == e)
        typical = float(d.column_gap[columns].sum()) if e in effects else gap * n
        hypotheses.append(Hypothesis(Named(e), Variant(e, free), columns, typical))
    return replace(d, hypotheses=tuple(hypotheses))


def named(d, *names):
    """The first hypothesis of each name."""
    return tuple(next(h for h in d.hypotheses if h.name == n) for n in names)


def noise(d, seed=0):
    """Noise (6 R,) of exactly the stated variance that no column can explain."""
    n = np.random.default_rng(seed).standard_normal(len(d.E))
    away = np.linalg.qr(d.E)[0]
    n -= away @ (away.T @ n)
    return n * np.sqrt(len(n) / (n @ n))


def readings(d, gaps, seed=0):
    """Readings (6 R,): each named effect adds a gap with its first column, or a kernel all its."""
    y = noise(d, seed)
    for name, gap in gaps.items():
        if name in d.kernels:
            columns = d.kernels[name]
        else:
            columns = np.array([[e for e, _ in d.label].index(name)])
        y = y + d.E[:, columns] @ np.sqrt(gap / len(columns) / d.configured_gap[columns])
    return y


def refitter(d, y):
    """What refits structures to these readings."""
    return LinearRefitter(Searcher(d), y)
