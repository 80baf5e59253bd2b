"""Signatures (changes of readings) of the library's effects on a robot, and which are alike there.

Linear in an effect's sizes where the effect is, with a grid of variants where it is not. From
MuJoCo and finite differences; no code is shared with the library of effects. Typical sizes and the
grids of variants are estimates.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import NamedTuple

import numpy as np
from scipy.optimize import lsq_linear

from wrenchbed.benchmark.fault import STATED, UsualFit
from wrenchbed.benchmark.mujoco_loads import RigidBodies, wrench_at
from wrenchbed.benchmark.referee.lags_friction_and_noise import after, bouc_wen, dahl, lowpass
from wrenchbed.benchmark.referee.machine import Ride
from wrenchbed.benchmark.referee.scenario import RefereeSetting
from wrenchbed.robots.base import INERTIA_AXES

_H = 1e-4
"""Step of finite differences [rad or m]: small beside a robot, its square above rounding."""
_COURSES = 6
"""Number of functions of time that a slow change of the tool is a sum of: a ramp, and sines."""
_AWAY = 0.03
"""Distance of lost mass from the tool's CoG, along each axis [m]."""
SAME = 0.1
"""An effect that imitates another up to this gap cannot be distinguished from it: a tenth of what
counts; minor imperfections together may leave four times as much."""
LARGEST = 8.0
"""Largest size, in multiples of typical, of an effect that imitates another: the largest size of a
drawn fault and as much again."""
_NEAREST = 4
"""Number of variants that are fitted with bounds."""


class _Columns:
    """Computes the changes of readings (n, 6) by each effect (signatures) at the n compared rows of
    a ``setting``, from the motion and load of a ``ride``."""

    def __init__(self, setting: RefereeSetting, ride: Ride) -> None:
        self.setting, self.ride, self.cut = setting, ride, setting.thin
        self.t, self.q, self.y = map(self.cut, (setting.path.t, setting.path.q, ride.load))
        self.base = setting.nominal[:: setting.stride]
        self.progress = (self.t - ride.path.t[0]) / (ride.path.t[-1] - ride.path.t[0])

    def gauges(self) -> Iterator[tuple[str, np.ndarray]]:
        t, y, load, cut = self.ride.path.t, self.y, self.ride.load, self.cut
        progress, zero = self.progress[:, None], self.setting.full_scale
        yield "sensor.drift", 3e-3 * _each(progress * zero)
        warm = self.setting.temperature
        lags = () if warm is None else (1.0, 15.0, 30.0, 45.0)
        for lag in lags:
            level = cut(after(t, np.asarray(warm)[:, None], lag))
            level = level / max(float(np.abs(level - level[0]).max()), 1e-9)
            both = [_each(level * zero), _each((level - level[0]) * y)]
            yield "sensor.temperature", 2e-3 * np.concatenate(both, -1)
        yield "sensor.gain", 0.01 * _each(y)
        pairs = [(i, j) for i in range(6) for j in range(6) if i != j]
        cross = np.zeros((*y.shape, len(pairs)))
        for k, (i, j) in enumerate(pairs):
            lever = 1.0 if i // 3 == j // 3 else (20.0 if i < 3 else 0.05)
            cross[:, i, k] = 8e-3 * lever * y[:, j]
        yield "sensor.crosstalk", cross
        u = y / self.setting.swing
        for bow in (u**2, np.abs(u), u**3, np.abs(u) ** 1.5, u * np.abs(u) ** 3):
            yield "sensor.nonlinearity", 2e-3 * _each(bow * zero)
        for reach in (0.05, 0.1, 0.2, 0.35):
            loop = bouc_wen(load / (reach * self.setting.swing), 0.7)
            yield "sensor.hysteresis", 1.5e-3 * _each(cut(loop) * zero)
        for time in (8.0, 25.0, 80.0, 250.0):
            yield "sensor.creep", 8e-3 * _each(cut(after(t, load, time)) - y)
        for when in np.linspace(0.05, 0.95, 60):
            yield "sensor.jump", 4e-3 * _each((progress > when) * zero)
        for part in (0.8, 0.9, 0.95, 0.98):
            limit = np.quantile(np.abs(y), part, axis=0)
            yield "sensor.saturation", _each(np.clip(y, -limit, limit) - y)

    def times(self) -> Iterator[tuple[str, np.ndarray]]:
        if self.setting.mode != "dynamic":
            return
        t, y, cut = self.ride.path.t, self.ride.load, self.cut
        dt, rate = float(t[1] - t[0]), np.gradient(y, t, axis=0)
        yield "timing.delay", 7e-3 * cut(rate)[..., None]
        for time in (4e-3, 15e-3):
            for stages in (1, 2):
                yield "timing.lowpass", (cut(lowpass(y, dt, time, stages)) - cut(y))[..., None]
        yield "timing.skew", 0.012 / t[-1] * cut(rate * t[:, None])[..., None]
        yield "timing.skew", 1e-3 * cut(rate * np.arange(6))[..., None]

    def tool(self) -> Iterator[tuple[str, np.ndarray]]:
        force = self.y[:, :3]
        yield "tool.flexure", 5e-5 * np.stack([_moved(force * e, force) for e in np.eye(3)], -1)
        for axis in _directions():
            side = np.sign(force @ axis)[:, None]
            yield "tool.loose", _moved(7.5e-4 * side * axis, force)[..., None]
        waves = (np.sin(np.pi * k * self.progress) / 3.0 / k**2 for k in range(1, _COURSES))
        courses = np.stack([self.progress, *waves], axis=1)[:, None, :]
        tool = self.setting.robot.tool(self.setting.theta)
        cog = np.asarray(tool.cog)
        weight = float(tool.mass) * self.cut(self.ride.in_sensor(self.ride.gravity))
        levers = [_moved(e, weight) for e in np.eye(3)]
        for away in _AWAY * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)]):
            yield "tool.leak", 0.015 * courses * wrench_at(cog + away, weight)[..., None]
        leaving = np.stack([wrench_at(cog, weight), *levers], -1)
        progress = self.progress[:, None, None]
        yield "tool.leak", progress * leaving * [0.015, 3e-4, 3e-4, 3e-4]
        yield "tool.slide", 2e-3 * progress * np.stack(levers, -1)
        yield "tool.slide", 2e-3 * np.concatenate([courses * x[..., None] for x in levers], -1)

    def carried(self) -> Iterator[tuple[str, np.ndarray]]:
        setting, last = self.setting, self.ride.path.q[:, -1]
        twists = [np.eye(6)[5] * self.cut(x[:, None]) for x in (last, dahl(last, 0.1))]
        yield "cable.torsion", 6.0 * setting.noise[5] * np.stack(twists, -1)
        if setting.mode == "dynamic":
            columns = []
            for a in INERTIA_AXES:
                theta = self.larger(f"tool.inertia.{a}")
                size = 0.25 * float(np.trace(np.asarray(setting.robot.tool(theta).inertia))) / 3.0
                change = setting.stated(theta, None, setting.stride) - self.base
                columns.append(change * size / _H)
            yield "tool.inertia", np.stack(columns, -1)
        rotation, position = self.cut(self.ride.rotation), self.cut(self.ride.position)
        yield from _pulls(rotation, position)
        tip = max(2.0 * float(setting.robot.tool(setting.theta).cog[2]), 0.05)
        yield from _pushes(rotation, position, tip)

    def arm(self) -> Iterator[tuple[str, np.ndarray]]:
        setting, robot, theta, q = self.setting, self.setting.robot, self.setting.theta, self.q
        force, torque = self.base[:, :3], self.base[:, 3:]
        rotated = [np.concatenate([np.cross(force, e), np.cross(torque, e)], 1) for e in np.eye(3)]
        yield "mount.rotation", np.deg2rad(0.4) * np.stack(rotated, -1)
        tilt = np.deg2rad(0.4) * np.stack(self.leaning(), -1)
        yield "base.tilt", tilt
        slopes = []
        for step in _H * np.eye(len(robot.joints)):
            ahead = setting.stated(theta, step, setting.stride)
            slopes.append((ahead - setting.stated(theta, -step, setting.stride)) / (2 * _H))
        yield "joint.offset", np.deg2rad(0.2) * np.stack(slopes[1:], -1)
        load, moment = self.weights()
        rotating = [j for j, joint in enumerate(robot.joints) if joint.unit == "rad" and j]
        soft = np.stack([slopes[j] * load[:, j, None] for j in rotating], -1)
        yield "joint.compliance", soft / 5e3
        for j in rotating:
            side = np.deg2rad(0.04) * np.sign(load[:, j, None])
            yield "joint.backlash", (slopes[j] * side)[..., None]
            for order in (1, 2, 3, 4):
                waves = (np.sin(order * q[:, j]), np.cos(order * q[:, j]))
                wave = np.stack([slopes[j] * w[:, None] for w in waves], -1)
                yield "joint.gear_error", np.deg2rad(4.0 / 60.0) * wave
        lean = np.moveaxis(tilt / np.deg2rad(0.4), -1, 0)
        x, y = moment[:, :1], moment[:, 1:2]
        three = [x * lean[0], y * lean[1], y * lean[0] + x * lean[1]]
        yield "base.compliance", 2e-5 * np.stack(three, -1)
        for name in robot.parameters.names:
            if name[0] == "L" and name[1:].isdigit():
                change = setting.stated(self.larger(name), None, setting.stride) - self.base
                yield "link.length", 7e-4 * (change / _H)[..., None]

    def larger(self, name: str) -> np.ndarray:
        """Parameters (P,) of the stated robot with the named one larger by a step."""
        theta = self.setting.theta.copy()
        theta[self.setting.robot.parameters.index(name)] += _H
        return theta

    def leaning(self) -> list[np.ndarray]:
        """Derivatives (n, 6) of the wrench by turns of gravity about x, y; inertial load stays."""
        robot, theta = self.setting.robot, self.setting.theta
        tool, gravity = robot.tool(theta), np.array(robot.gravity)
        turns = np.broadcast_to(robot.sensor_pose(self.q, theta)[0], (len(self.q), 3, 3))
        weights = [float(tool.mass) * np.cross(axis, gravity) for axis in np.eye(3)[:2]]
        forces = [np.einsum("nij,i->nj", turns, weight) for weight in weights]
        return [wrench_at(np.asarray(tool.cog), force) for force in forces]

    def weights(self) -> tuple[np.ndarray, np.ndarray]:
        """Torque of gravity on each joint (n, J) by virtual work, and on the base (n, 2) [N·m]."""
        robot, q = self.setting.robot, self.q
        bodies, g = RigidBodies(robot, self.setting.theta), np.array(robot.gravity)
        centre, mass = bodies.first_moments, bodies.model.body_mass.sum()
        steps = _H * np.eye(q.shape[1])
        torque = np.stack([(centre(q + s) - centre(q - s)) @ g / (2 * _H) for s in steps], -1)
        base = bodies.model.body("base").pos
        return torque, np.cross(centre(q) - mass * base, g)[:, :2]


def _each(y: np.ndarray) -> np.ndarray:
    """Columns (n, 6, 6), each with one channel of y (n, 6) and zeros elsewhere."""
    return y[:, :, None] * np.eye(6)


def _moved(shift: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Wrench (n, 6) [N, N·m] added if forces (n, 3) are shifted by (n, 3) or (3,) [m]."""
    return np.concatenate([np.zeros_like(force), np.cross(shift, force)], axis=1)


def _directions() -> np.ndarray:
    """Directions (26, 3) from a point of a cubic grid to its 26 neighbours, unit vectors."""
    grid = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3), -1).reshape(-1, 3)
    grid = grid[np.abs(grid).sum(axis=1) > 0]
    return np.asarray(grid / np.linalg.norm(grid, axis=1, keepdims=True))


def _pulls(rotation: np.ndarray, position: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Yield (name, columns) by hoses from above, at sensor poses (n, 3, 3), (n, 3)."""
    reach = max(1.5 * float(np.linalg.norm(position.std(axis=0))), 0.2)
    point = np.array([0.0, 0.0, 0.04])
    tied = position + rotation @ point
    for direction in _directions():
        if direction[2] < 0.2:
            continue
        for far in (0.8, 1.5):
            line = position.mean(axis=0) + far * reach * direction - tied
            length = np.linalg.norm(line, axis=1, keepdims=True)
            for part in (0.0, 0.3, 0.6):
                taut = np.maximum(length - np.quantile(length, part), 0.0)
                taut = 0.3 * taut / max(float(taut.mean()), 1e-6)
                force = np.einsum("nij,ni->nj", rotation, taut * line / length)
                yield "cable.pull", wrench_at(point, force)[..., None]


def _pushes(
    rotation: np.ndarray, position: np.ndarray, tip: float
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield (name, columns) by planes that push the tool's end, ``tip`` [m] along z."""
    lever = np.array([0.0, 0.0, tip])
    ends = position + rotation @ lever
    for normal in _directions():
        height = ends @ normal
        for part in (0.06, 0.12, 0.2):
            deep = np.maximum(np.quantile(height, part) - height, 0.0)
            deep = 0.4 * deep / max(float(deep[deep > 0].mean()), 1e-6)
            force = np.einsum("nij,ni->nj", rotation, deep[:, None] * normal)
            yield "environment.contact", wrench_at(lever, force)[..., None]


class Block(NamedTuple):
    """Signature of an effect of one shape: columns q r, q (6 n, k) orthonormal, r (k, c)."""

    q: np.ndarray
    r: np.ndarray

    def residual(self, x: np.ndarray, bounded: bool) -> float:
        """Sum of squares of x (6 n,) after the best fit, ``bounded`` to plausible amplitudes."""
        projection = self.q.T @ x
        free = float(x @ x) - float(projection @ projection)
        if not bounded:
            return free
        best = lsq_linear(self.r, projection, (-LARGEST, LARGEST)).x
        return free + float(np.sum((self.r @ best - projection) ** 2))


@dataclass(frozen=True, eq=False)
class Bench:
    """Signatures of the library's effects on one robot: columns (6 n, k), one array a shape, of
    typical size in units of row noise, and the ``usual`` fit of bias, mass and CoG before them."""

    usual: UsualFit
    columns: Mapping[str, list[np.ndarray]]

    @cached_property
    def alone(self) -> Mapping[str, list[Block]]:
        """Signatures of each effect's shapes without any other fit, by name of the effect."""
        return {name: [_block(w) for w in variants] for name, variants in self.columns.items()}

    @cached_property
    def beside(self) -> Mapping[str, list[Block]]:
        """Signatures of each effect's shapes after the fit of bias, mass and CoG, by name."""
        basis = self.usual.basis
        return {k: [_block(w - basis @ (basis.T @ w)) for w in v] for k, v in self.columns.items()}

    def imitated(
        self, signature: np.ndarray, configured: bool, bounded: bool = True
    ) -> dict[str, float]:
        """Gap (mean square over row noise) left of a signature (n, 6) by each effect's best fit, by
        name; ``configured``: bias, mass, CoG not fitted too; ``bounded``: plausible amplitudes."""
        x = self.usual.white(signature, configured)
        remaining = {}
        for name, variants in (self.alone if configured else self.beside).items():
            free = [b.residual(x, bounded=False) for b in variants]
            near = sorted(range(len(variants)), key=lambda k: free[k])[:_NEAREST]
            least = free[near[0]]
            if bounded and least <= SAME * len(x):
                least = min(variants[k].residual(x, bounded=True) for k in near)
            remaining[name] = max(0.0, least) / len(x)
        return remaining

    def alike(self, name: str, signature: np.ndarray) -> list[str]:
        """Other effects that this data cannot distinguish from one with a signature (n, 6)."""
        remaining = self.imitated(signature, name in STATED)
        near = [k for k, gap in remaining.items() if k != name and gap <= SAME]
        return sorted(near, key=lambda k: remaining[k])

    def shows(self, data: np.ndarray, signature: np.ndarray, configured: bool) -> bool:
        """Whether data (n, 6), less stated readings and other known faults, contain a signature:
        its subtraction removes half of its square; ``configured``: bias, mass, CoG not fitted."""
        x, s = self.usual.white(data, configured), self.usual.white(signature, configured)
        fall = float(x @ x) - float((x - s) @ (x - s))
        return fall >= 0.5 * float(s @ s)


def _block(columns: np.ndarray) -> Block:
    u, s, vt = np.linalg.svd(columns, full_matrices=False)
    kept = s > max(1e-6 * float(s[0]), 1e-9)
    return Block(u[:, kept], s[kept, None] * vt[kept])


def bench(setting: RefereeSetting, ride: Ride) -> Bench:
    """Compute the signatures on a robot of every effect that changes mean readings."""
    make, columns = _Columns(setting, ride), dict[str, list[np.ndarray]]()
    groups = make.gauges(), make.times(), make.tool(), make.carried(), make.arm()
    for name, block in chain(*groups):
        white = (block / setting.noise[:, None]).reshape(-1, block.shape[-1])
        columns.setdefault(name, []).append(white)
    return Bench(setting.usual, columns)
