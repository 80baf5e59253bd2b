"""Signatures of the library's effects on one robot, and which effects its data cannot tell apart.

Linear in an effect's sizes where the effect is, with a grid of variants where it is not. From
MuJoCo and finite differences; no code is shared with the library of effects. Typical sizes and the
grids of variants are estimates.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import chain
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.optimize import lsq_linear

from wrenchbed.benchmark.frame import STATED, Usual
from wrenchbed.benchmark.referee.laws import after, bouc_wen, dahl, lowpass
from wrenchbed.benchmark.referee.machine import Ride
from wrenchbed.benchmark.referee.scenario import RefereeSetting
from wrenchbed.robots.base import INERTIA_AXES

Blocks = Mapping[str, list[np.ndarray]]
"""Signatures by effect, one array (n, 6, k) for each variant: wrench [N, N·m] of columns of typical
size."""
_H = 1e-4
"""Step of finite differences [rad or m]: an estimate."""
_COURSES = 6
"""Courses in time that a slow change of the tool may be made of: an even one, and half waves."""
_AWAY = 0.03
"""Distance of lost mass from the tool's CoG, along each axis [m]."""
SAME = 0.1
"""An effect that imitates another up to this gap cannot be distinguished from it: an estimate;
minor imperfections together may leave four times as much."""
LARGEST = 8.0
"""Largest size, in multiples of typical, of an effect that imitates another: an estimate."""
_NEAREST = 4
"""Number of variants that are fitted with bounds."""


class Signature(NamedTuple):
    """Points at which signatures are compared: mean times (n,), joints (n, J), readings (n, 6)."""

    t: np.ndarray
    q: np.ndarray
    y: np.ndarray


def blocks(setting: RefereeSetting, ride: Ride) -> Blocks:
    """Signatures of every effect that a mean can show."""
    seen = _seen(setting, ride)
    result: dict[str, list[np.ndarray]] = {}
    for name, block in chain(
        _gauges(setting, ride, seen), _times(setting, ride), _tool(setting, ride, seen),
        _carried(setting, ride, seen), _arm(setting, seen),
    ):  # fmt: skip
        result.setdefault(name, []).append(block)
    return result


def _seen(setting: RefereeSetting, ride: Ride) -> Signature:
    return Signature(*(setting.thin(x) for x in (setting.path.t, setting.path.q, ride.load)))


def _each(y: np.ndarray) -> np.ndarray:
    """Columns (n, 6, 6), one for each channel of y (n, 6)."""
    return y[:, :, None] * np.eye(6)


def _gauges(
    setting: RefereeSetting, ride: Ride, seen: Signature
) -> Iterator[tuple[str, np.ndarray]]:
    t, y, load = ride.path.t, seen.y, ride.load
    progress = ((seen.t - t[0]) / (t[-1] - t[0]))[:, None]
    zero = setting.full_scale
    yield "sensor.drift", 3e-3 * _each(progress * zero)
    warm = setting.temperature
    lags = () if warm is None else (1.0, 15.0, 30.0, 45.0)
    for lag in lags:
        level = setting.thin(after(t, np.asarray(warm)[:, None], lag))
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
    u = y / setting.swing
    for bow in (u**2, np.abs(u), u**3, np.abs(u) ** 1.5, u * np.abs(u) ** 3):
        yield "sensor.nonlinearity", 2e-3 * _each(bow * zero)
    for reach in (0.05, 0.1, 0.2, 0.35):
        loop = bouc_wen(load / (reach * setting.swing), 0.7)
        yield "sensor.hysteresis", 1.5e-3 * _each(setting.thin(loop) * zero)
    for time in (8.0, 25.0, 80.0, 250.0):
        yield "sensor.creep", 8e-3 * _each(setting.thin(after(t, load, time)) - y)
    for when in np.linspace(0.05, 0.95, 60):
        yield "sensor.jump", 4e-3 * _each((progress > when) * zero)
    for part in (0.8, 0.9, 0.95, 0.98):
        limit = np.quantile(np.abs(y), part, axis=0)
        yield "sensor.saturation", _each(np.clip(y, -limit, limit) - y)


def _times(setting: RefereeSetting, ride: Ride) -> Iterator[tuple[str, np.ndarray]]:
    if setting.mode != "dynamic":
        return
    t, y = ride.path.t, ride.load
    dt, rate = float(t[1] - t[0]), np.gradient(y, ride.path.t, axis=0)
    cut = setting.thin
    yield "timing.delay", 7e-3 * cut(rate)[..., None]
    for time in (4e-3, 15e-3):
        for stages in (1, 2):
            yield "timing.lowpass", (cut(lowpass(y, dt, time, stages)) - cut(y))[..., None]
    yield "timing.skew", 0.012 / t[-1] * cut(rate * t[:, None])[..., None]
    yield "timing.skew", 1e-3 * cut(rate * np.arange(6))[..., None]


def _tool(setting: RefereeSetting, ride: Ride, seen: Signature) -> Iterator[tuple[str, np.ndarray]]:
    force = seen.y[:, :3]
    zero = np.zeros_like(force)
    bent = [np.concatenate([zero, np.cross(force * e, force)], 1) for e in np.eye(3)]
    yield "tool.flexure", 5e-5 * np.stack(bent, -1)
    for axis in _directions():
        side = np.sign(force @ axis)[:, None]
        moved = np.cross(7.5e-4 * side * axis, force)
        yield "tool.loose", np.concatenate([zero, moved], 1)[..., None]
    yield from _over_time(setting, seen, setting.thin(ride.in_sensor(ride.gravity)))


def _carried(
    setting: RefereeSetting, ride: Ride, seen: Signature
) -> Iterator[tuple[str, np.ndarray]]:
    cut = setting.thin
    last = ride.path.q[:, -1]
    twists = [np.eye(6)[5] * cut(x[:, None]) for x in (last, dahl(last, 0.1))]
    twist = np.stack(twists, -1)
    yield "cable.torsion", 6.0 * setting.noise[5] * twist
    if setting.mode == "dynamic":
        base = setting.nominal[:: setting.stride]
        columns = []
        for a in INERTIA_AXES:
            theta = setting.theta.copy()
            theta[setting.robot.parameters.index(f"tool.inertia.{a}")] += _H
            size = 0.25 * float(np.trace(np.asarray(setting.robot.tool(theta).inertia))) / 3.0
            columns.append((setting.stated(theta, every=setting.stride) - base) * size / _H)
        yield "tool.inertia", np.stack(columns, -1)
    rotation, position = cut(ride.rotation), cut(ride.position)
    yield from _pulls(rotation, position)
    tip = max(2.0 * float(setting.robot.tool(setting.theta).cog[2]), 0.05)
    yield from _pushes(rotation, position, tip)


def _over_time(
    setting: RefereeSetting, seen: Signature, gravity: np.ndarray
) -> Iterator[tuple[str, np.ndarray]]:
    """Mass that leaves the tool, and a CoG that moves, in gravity as the sensor sees it (n, 3)."""
    tool = setting.robot.tool(setting.theta)
    progress = (seen.t - setting.path.t[0]) / (setting.path.t[-1] - setting.path.t[0])
    rows = [progress, *(np.sin(np.pi * k * progress) / 3.0 / k**2 for k in range(1, _COURSES))]
    courses = np.stack(rows, axis=1)[:, None, :]
    weight = float(tool.mass) * gravity
    zero = np.zeros_like(weight)
    levers = [np.concatenate([zero, np.cross(e, weight)], axis=1) for e in np.eye(3)]
    away = _AWAY * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
    for place in np.asarray(tool.cog) + away:
        gone = np.concatenate([weight, np.cross(place, weight)], axis=1)[..., None]
        yield "tool.leak", 0.015 * courses * gone
    leaving = np.stack([np.concatenate([weight, np.cross(tool.cog, weight)], 1), *levers], -1)
    yield "tool.leak", progress[:, None, None] * leaving * [0.015, 3e-4, 3e-4, 3e-4]
    yield "tool.slide", 2e-3 * progress[:, None, None] * np.stack(levers, -1)
    yield "tool.slide", 2e-3 * np.concatenate([courses * x[..., None] for x in levers], -1)


def _pulls(rotation: np.ndarray, position: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Signatures of hoses from above, from several sides and with several slacks."""
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
                yield "cable.pull", np.concatenate([force, np.cross(point, force)], 1)[..., None]


def _pushes(
    rotation: np.ndarray, position: np.ndarray, tip: float
) -> Iterator[tuple[str, np.ndarray]]:
    """Signatures of planes that the tool's end presses on."""
    lever = np.array([0.0, 0.0, tip])
    ends = position + rotation @ lever
    for normal in _directions():
        height = ends @ normal
        for part in (0.06, 0.12, 0.2):
            deep = np.maximum(np.quantile(height, part) - height, 0.0)
            deep = 0.4 * deep / max(float(deep[deep > 0].mean()), 1e-6)
            force = np.einsum("nij,ni->nj", rotation, deep[:, None] * normal)
            block = np.concatenate([force, np.cross(lever, force)], 1)[..., None]
            yield "environment.contact", block


def _arm(setting: RefereeSetting, seen: Signature) -> Iterator[tuple[str, np.ndarray]]:
    every, robot, theta = setting.stride, setting.robot, setting.theta
    base = setting.nominal[::every]
    rotation = np.broadcast_to(robot.sensor_pose(seen.q, theta)[0], (len(seen.q), 3, 3))
    turned = dict(_turned(setting, base, rotation))
    yield from turned.items()
    slopes = []
    for j in range(len(robot.joints)):
        step = _H * np.eye(len(robot.joints))[j]
        ahead = setting.stated(theta, step, every)
        slopes.append((ahead - setting.stated(theta, -step, every)) / (2 * _H))
    slope = np.stack(slopes[1:], -1)
    yield "joint.offset", np.deg2rad(0.2) * slope
    load, moment = _weights(setting, seen.q)
    rotating = [j for j, joint in enumerate(robot.joints) if joint.unit == "rad" and j]
    yield "joint.compliance", np.stack([slopes[j] * load[:, j, None] for j in rotating], -1) / 5e3
    for j in rotating:
        side = np.deg2rad(0.04) * np.sign(load[:, j, None])
        yield "joint.backlash", (slopes[j] * side)[..., None]
        for order in (1, 2, 3, 4):
            waves = (np.sin(order * seen.q[:, j]), np.cos(order * seen.q[:, j]))
            wave = np.stack([slopes[j] * w[:, None] for w in waves], -1)
            yield "joint.gear_error", np.deg2rad(4.0 / 60.0) * wave
    lean = np.moveaxis(turned["base.tilt"] / np.deg2rad(0.4), -1, 0)
    x, y = moment[:, :1], moment[:, 1:2]
    three = [x * lean[0], y * lean[1], y * lean[0] + x * lean[1]]
    yield "base.compliance", 2e-5 * np.stack(three, -1)
    for name in robot.parameters.names:
        if name[0] == "L" and name[1:].isdigit():
            longer = theta.copy()
            longer[robot.parameters.index(name)] += _H
            change = (setting.stated(longer, None, every) - base) / _H
            yield "link.length", 7e-4 * change[..., None]


def _turned(
    setting: RefereeSetting, wrench: np.ndarray, rotation: np.ndarray
) -> Iterator[tuple[str, np.ndarray]]:
    """A sensor that is rotated, and gravity that is, in orientations (n, 3, 3)."""
    force, torque = wrench[:, :3], wrench[:, 3:]
    rotated = [np.concatenate([np.cross(force, e), np.cross(torque, e)], 1) for e in np.eye(3)]
    yield "mount.rotation", np.deg2rad(0.4) * np.stack(rotated, -1)
    lean = [_tilted(setting, axis, rotation) for axis in np.eye(3)[:2]]
    yield "base.tilt", np.deg2rad(0.4) * np.stack(lean, -1)


def _tilted(setting: RefereeSetting, axis: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """∂w/∂α of gravity turned about an axis: the tool's weight turns, its inertia does not."""
    tool = setting.robot.tool(setting.theta)
    weight = float(tool.mass) * np.cross(axis, np.array(setting.robot.gravity))
    force = np.einsum("nij,i->nj", rotation, weight)
    return np.concatenate([force, np.cross(np.asarray(tool.cog), force)], axis=1)


def _weights(setting: RefereeSetting, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Torque of gravity on each joint (n, J) by virtual work, and on the base (n, 2) [N·m]."""
    robot, theta = setting.robot, setting.theta
    model = robot.spec(theta).compile()
    data = mujoco.MjData(model)
    g = np.array(robot.gravity)

    def centre(rows: np.ndarray) -> np.ndarray:
        out = np.empty((len(rows), 3))
        for i, row in enumerate(np.asarray(robot.qpos(rows, theta))):
            data.qpos[:] = row
            mujoco.mj_kinematics(model, data)
            out[i] = model.body_mass @ data.xipos
        return out

    steps = _H * np.eye(q.shape[1])
    torque = np.stack([(centre(q + s) - centre(q - s)) @ g / (2 * _H) for s in steps], -1)
    base = model.body("base").pos
    return torque, np.cross(centre(q) - model.body_mass.sum() * base, g)[:, :2]


def _directions() -> np.ndarray:
    """The 26 directions to the neighbours in a cubic grid (26, 3)."""
    grid = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3), -1).reshape(-1, 3)
    grid = grid[np.abs(grid).sum(axis=1) > 0]
    return np.asarray(grid / np.linalg.norm(grid, axis=1, keepdims=True))


class Block(NamedTuple):
    """A variant of an effect: orthonormal q (6 n, k), and r (k, c) with columns = q r."""

    q: np.ndarray
    r: np.ndarray

    def residual(self, x: np.ndarray, bounded: bool) -> float:
        """Squared residual of x (6 n,) after the best imitation.

        Args:
            bounded: with sizes that a robot may have.
        """
        projection = self.q.T @ x
        free = float(x @ x) - float(projection @ projection)
        if not bounded:
            return free
        best = lsq_linear(self.r, projection, (-LARGEST, LARGEST)).x
        return free + float(np.sum((self.r @ best - projection) ** 2))


@dataclass(frozen=True, eq=False)
class Bench:
    """Signatures of the library on one robot.

    Attributes:
        usual: what every fit takes out.
        alone, beside: variants by effect, as they are and after the usual fit.
    """

    usual: Usual
    alone: Mapping[str, list[Block]]
    beside: Mapping[str, list[Block]]

    def imitated(
        self, signature: np.ndarray, configured: bool, bounded: bool = True
    ) -> dict[str, float]:
        """Gap that remains of a signature (n, 6) when each effect imitates it as well as it can.

        Args:
            bounded: with sizes that a robot may have, where any sizes imitate it.
        """
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
        """Whether data contain a signature: subtracting it removes at least half of its square.

        Args:
            data: measured minus stated, and minus all other known faults (n, 6).
        """
        x, s = self.usual.white(data, configured), self.usual.white(signature, configured)
        fall = float(x @ x) - float((x - s) @ (x - s))
        return fall >= 0.5 * float(s @ s)


def bench(setting: RefereeSetting, ride: Ride, usual: Usual) -> Bench:
    """Signatures of every effect for one robot."""
    alone, beside = {}, {}
    for name, variants in blocks(setting, ride).items():
        white = [_white(b, setting.noise) for b in variants]
        alone[name] = [_block(w) for w in white]
        beside[name] = [_block(w - usual.basis @ (usual.basis.T @ w)) for w in white]
    return Bench(usual, alone, beside)


def _white(block: np.ndarray, noise: np.ndarray) -> np.ndarray:
    return np.asarray((block / noise[:, None]).reshape(-1, block.shape[-1]))


def _block(columns: np.ndarray) -> Block:
    u, s, vt = np.linalg.svd(columns, full_matrices=False)
    kept = s > max(1e-6 * float(s[0]), 1e-9)
    return Block(u[:, kept], s[kept, None] * vt[kept])
