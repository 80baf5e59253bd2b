"""Information of poses, linear about the nominal robot: on its accuracy, or on its effect."""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from wrenchbed.calibration.accuracy import Goal, tip_jacobian
from wrenchbed.campaigns.settings import possible
from wrenchbed.effects.chain import ActiveEffect, respond
from wrenchbed.effects.scene import Scene
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.simulation.closed_form import Model

_TARGETS, _SEED = 200, 20_160_798
"""Poses at which accuracy is judged, and the seed that chooses them."""
_APART = 9.0
"""Squared distance [σ²] from which two causes count as distinguished: 3 σ."""


def knowledge(
    model: Model, pool: np.ndarray, std: np.ndarray, goal: str
) -> "AccuracyKnowledge | CauseKnowledge":
    """What is known before any pose of a pool (N, J) is read with ``std`` (6,) [N, N·m]."""
    columns = model.parameters.select(model.robot.free)
    if goal == "causes":
        return _causes(model, pool, std, columns)
    scale = model.parameters.tolerance[list(columns)]
    nominal = model.parameters.nominal
    rows = model.jacobian(pool, nominal, columns) * scale / std[:, None]
    robot = model.robot
    target = robot.target() if isinstance(robot, SimulatedRobot) else None
    rng = np.random.default_rng(_SEED)
    if target is not None:
        chosen = target[rng.permutation(len(target))[:_TARGETS]]
        unit, sensitivity = "m", tip_jacobian(robot, chosen, nominal, columns) * scale
    else:
        q = robot.sample(_TARGETS, rng)
        unit, sensitivity = "N", model.jacobian(q, nominal, columns)[:, :3] * scale
    return AccuracyKnowledge(columns, unit, rows, Goal(sensitivity).weight, np.eye(len(columns)))


@dataclass(frozen=True, eq=False)
class AccuracyKnowledge:
    """What some poses tell of the accuracy.

    Attributes:
        columns: parameters that differ from robot to robot.
        unit: of errors.
        rows: readings of each pose of the pool by the parameters, in noise and tolerances
            (N, 6, K).
        weight: trace(weight · covariance) is the mean square error (K, K).
        covariance: of the parameters in tolerances (K, K).
    """

    columns: tuple[int, ...]
    unit: str
    rows: np.ndarray
    weight: np.ndarray
    covariance: np.ndarray

    @cached_property
    def error(self) -> float:
        """Expected rms error [unit]."""
        return math.sqrt(np.vdot(self.weight, self.covariance))  # trace of the product

    @cached_property
    def value(self) -> float:
        """Information [nats]; grows with every informative pose."""
        return -math.log(self.error)

    @property
    def open(self) -> tuple[float, float]:
        """Least and mean remaining share of the initial uncertainty, 0 … 1."""
        std = np.sqrt(np.minimum(np.maximum(self.covariance.diagonal(), 0.0), 1.0))
        return float(std.min()), float(std.sum()) / len(std)

    def with_pose(self, pose: int) -> "AccuracyKnowledge":
        """After one more pose of the pool."""
        rows = self.rows[pose]
        half = rows @ self.covariance
        reading = half @ rows.T
        reading.flat[:: len(reading) + 1] += 1.0  # the noise
        smaller = self.covariance - half.T @ np.linalg.solve(reading, half)
        return replace(self, covariance=0.5 * (smaller + smaller.T))

    def gains(self) -> np.ndarray:
        """Rise of ``value`` by each pose of the pool (N,)."""
        half = self.rows @ self.covariance
        reading = np.eye(self.rows.shape[1]) + half @ np.swapaxes(self.rows, 1, 2)
        less = half @ self.weight @ np.swapaxes(half, 1, 2)
        off = np.trace(np.linalg.solve(reading, less), axis1=1, axis2=2)
        squared_error = np.maximum(self.error**2 - off, 1e-300)
        return np.asarray(-0.5 * np.log(squared_error) - self.value)


def _causes(
    model: Model, pool: np.ndarray, std: np.ndarray, columns: tuple[int, ...]
) -> "CauseKnowledge":
    nuisance = list(model.parameters.select([*sorted(model.robot.load), "sensor.bias"]))
    nominal = model.parameters.nominal
    minor = model.jacobian(pool, nominal, nuisance) * model.parameters.tolerance[nuisance]
    marks, names = signatures(model, pool)
    rows = np.concatenate([minor, np.moveaxis(marks, 0, -1)], axis=2) / std[:, None]
    grams = np.swapaxes(rows, 1, 2) @ rows
    gram = np.zeros(grams.shape[1:])
    return CauseKnowledge(columns, "share of pairs", grams, len(nuisance), names, gram)


def signatures(model: Model, pool: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    """Changes by typical effects (C, N, 6) [N, N·m], of effects that ignore the order of poses."""
    order = np.random.default_rng(_SEED).permutation(len(pool))
    marks, names = [], []
    plain = respond(_scene(model, pool))
    for name, variants in possible(model.robot.name, "static").items():
        variant = max(variants, key=lambda v: v.weight)
        active = ActiveEffect.of(model.robot, name, {})
        known = active.effect.parameters(model.robot)
        size = {n: known[known.index(n)].tolerance for n in active.effect.usual(variant)}
        size |= {k: v for k, v in variant.at.items() if k not in size}
        own = (ActiveEffect.of(model.robot, name, size),)
        mark = respond(_scene(model, pool), own) - plain
        shuffled = respond(_scene(model, pool[order]), own) - plain[order]
        if np.abs(mark).max() > 1e-9 and np.allclose(shuffled, mark[order], atol=1e-9):
            marks.append(mark)
            names.append(name)
    return np.array(marks), tuple(names)


def _scene(model: Model, q: np.ndarray) -> Scene:
    robot = model.robot
    own = model.parameters.nominal[: len(robot.parameters)]
    held = np.ones(len(q), dtype=bool)
    return Scene(robot, own, np.array(model.gravity), q, 10.0 * np.arange(len(q)), held)


@dataclass(frozen=True, eq=False)
class CauseKnowledge:
    """What some poses tell of which effect is present; attributes as those of the accuracy.

    Attributes:
        grams: XᵀX of each pose of the pool (N, M, M): nuisance first, then causes, in noise.
        nuisance: how many columns are nuisance.
        names: of the causes.
        gram: of all readings (M, M).
    """

    columns: tuple[int, ...]
    unit: str
    grams: np.ndarray
    nuisance: int
    names: tuple[str, ...]
    gram: np.ndarray

    @cached_property
    def _apart(self) -> np.ndarray:
        return _distances(self.gram, self.nuisance)

    @cached_property
    def value(self) -> float:
        """Information [nats]; grows with every informative pose."""
        return float(0.5 * np.log1p(self._apart).mean())

    @cached_property
    def error(self) -> float:
        """Share of pairs of causes that are not distinguished."""
        return float((self._apart < _APART).mean())

    @property
    def open(self) -> tuple[float, float]:
        """Least and mean remaining share of the initial uncertainty, 0 … 1."""
        near = 1.0 / (1.0 + np.sqrt(self._apart))
        return float(near.min()), float(near.mean())

    def with_pose(self, pose: int) -> "CauseKnowledge":
        """After one more pose of the pool."""
        return replace(self, gram=self.gram + self.grams[pose])

    def gains(self) -> np.ndarray:
        """Rise of ``value`` by each pose of the pool (N,)."""
        ahead = _distances(self.gram + self.grams, self.nuisance)
        return np.asarray(0.5 * np.log1p(ahead).mean(axis=1) - self.value)


def _distances(gram: np.ndarray, nuisance: int) -> np.ndarray:
    """Squared distance (…, C(C−1)) [σ²] of each cause from every other one's best imitation.

    All causes have their typical size, imitations any size within a prior of typical size.
    """
    first = gram[..., :nuisance, :nuisance] + np.eye(nuisance)
    across = gram[..., :nuisance, nuisance:]
    causes = gram[..., nuisance:, nuisance:]
    causes = causes - np.swapaxes(across, -1, -2) @ np.linalg.solve(first, across)
    own = np.diagonal(causes, axis1=-2, axis2=-1)
    apart = own[..., :, None] - causes**2 / (own[..., None, :] + 1.0)
    pairs = ~np.eye(own.shape[-1], dtype=bool)
    return np.maximum(apart[..., pairs], 0.0)
