"""Faults of what the sensor carries and of what else pulls at it: tool, cables, contact.

Typical sizes and ranges are estimates.
"""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed.benchmark.frame import Rng, elapsed
from wrenchbed.benchmark.referee.fault import (
    RefereeFault,
    about,
    direction,
    drawn,
    sign,
)
from wrenchbed.benchmark.referee.machine import Hose, LoosePart, Mechanics, Pad, Ride
from wrenchbed.benchmark.referee.memory import dahl
from wrenchbed.benchmark.referee.scenario import RefereeSetting
from wrenchbed.robots.base import INERTIA_AXES

_G = 9.81
"""Gravity for typical forces [m/s²]: an estimate."""


@drawn("tool.mass", compared="mass")
def mass(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """The tool is about 2 % heavier or lighter than stated."""
    stated, least = _stated(setting)[0], 2.0 * setting.tolerance[0]
    error = sign(rng) * max(least, about(rng, 0.02 * size * stated))
    return RefereeFault({"mass": error}, body=lambda m: loaded(setting, m, dm=error))


@drawn("tool.cog", compared=r"cog\.[xyz]")
def cog(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Its centre of gravity is about 1.5 mm away from where it is stated."""
    error = max(2.0 * setting.tolerance[1], about(rng, 1.5e-3 * size)) * direction(rng)
    true = {f"cog.{a}": float(e) for a, e in zip("xyz", error, strict=True)}
    return RefereeFault(true, body=lambda m: loaded(setting, m, dc=error))


@drawn("tool.inertia", motion=True, compared=r"inertia\.[xyz]{2}")
def inertia(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Its moments of inertia are about 25 % off, and their axes a little askew."""
    stated = setting.metadata.tool.inertia
    assert stated is not None
    xx, yy, zz, xy, xz, yz = stated
    old = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    grown = np.diag(np.exp(0.25 * size * rng.uniform(0.4, 1.0, 3) * rng.choice([-1, 1], 3)))
    askew = Rotation.from_rotvec(0.15 * size * direction(rng)).as_matrix()
    new = askew @ np.sqrt(grown) @ old @ np.sqrt(grown) @ askew.T
    pick = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    names = [f"tool.inertia.{a}" for a in INERTIA_AXES]
    change = {n: float((new - old)[i]) for n, i in zip(names, pick, strict=True)}
    p = setting.robot.parameters

    def body(m: Mechanics) -> Mechanics:
        theta = m.theta.copy()
        for name, value in change.items():
            theta[p.index(name)] += value
        return replace(m, theta=theta)

    true = {k.removeprefix("tool."): v for k, v in change.items()}
    return RefereeFault(true, body=body)


@drawn("tool.loose")
def loose(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A part that slides to and fro in the tool and shifts its CoG by about 1.5 mm."""
    travel = about(rng, 1.5e-3 * size)
    share = float(rng.uniform(0.08, 0.2))
    part = LoosePart(share, direction(rng), 0.5 * travel / share, float(rng.uniform(0.05, 0.3)))
    return RefereeFault({"travel": travel}, body=lambda m: replace(m, loose=part))


@drawn("tool.leak")
def leak(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """About 1.5 % of the tool's mass is lost: by an exponential, in two stages, or in drops."""
    share = elapsed(setting.path.t)
    law = rng.choice(["exponential", "two stages", "drops"])
    if law == "exponential":
        gone = -np.expm1(-share / rng.uniform(0.2, 2.0))
    elif law == "two stages":
        when, slow = rng.uniform(0.25, 0.75), rng.uniform(0.0, 0.4)
        gone = slow * share + (1.0 - slow) * np.maximum(share - when, 0.0)
    elif law == "drops":
        gaps = rng.uniform(0.5, 1.5, int(rng.integers(15, 60)))
        gone = np.searchsorted(np.cumsum(gaps) / gaps.sum(), share, "right").astype(float)
    else:  # they fall off, one after the other
        moments = np.sort(rng.uniform(0.0, 1.0, int(rng.integers(2, 7))))
        parts = np.append(0.0, np.cumsum(rng.uniform(0.3, 1.0, len(moments))))
        gone = parts[np.searchsorted(moments, share)]
    lost = about(rng, 0.015 * size * _stated(setting)[0]) * gone / gone[-1]
    lost = lost * float(rng.choice([1.0, 1.0, 1.0, -1.0]))  # or it fills up
    place = _stated(setting)[1] + 0.02 * rng.standard_normal(3)

    def load(ride: Ride, y: np.ndarray) -> np.ndarray:
        pull = -lost[:, None] * _pull(ride, place)
        return y + np.concatenate([pull, np.cross(place, pull)], axis=1)

    return RefereeFault({"lost": float(lost[-1])}, load=load)


@drawn("tool.slide")
def slide(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """The CoG moves by about 2 mm: a clamp creeps (Kohlrausch), or it sticks and slips."""
    share = elapsed(setting.path.t)
    if rng.uniform() < 0.5:
        law = -np.expm1(-((share / rng.uniform(0.1, 1.0)) ** rng.uniform(0.4, 1.0)))
    else:
        waits = rng.gamma(4.0, 1.0, int(rng.integers(12, 40)))
        law = np.searchsorted(np.cumsum(waits) / waits.sum(), share, "right").astype(float)
    way = about(rng, 2e-3 * size) * direction(rng)
    moved = np.outer(law / law[-1], way)
    mass, cog = _stated(setting)

    def load(ride: Ride, y: np.ndarray) -> np.ndarray:
        torque = np.cross(moved, mass * _pull(ride, cog))
        return y + np.concatenate([np.zeros_like(torque), torque], axis=1)

    true = {f"moved.{a}": float(m) for a, m in zip("xyz", moved[-1], strict=True)}
    return RefereeFault(true, load=load)


@drawn("tool.flexure")
def flexure(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A tool whose root bends, so that its CoG moves by about 5e-5 m/N, unequally across."""
    root = float(rng.uniform(0.0, 0.3)) * float(_stated(setting)[1][2])
    lever = max(float(np.linalg.norm(_stated(setting)[1] - [0.0, 0.0, root])), 0.02)
    bend = about(rng, 5e-5 * size) / lever**2 * np.array([1.0, rng.uniform(0.5, 1.0)])
    bend = bend if rng.uniform() < 0.5 else bend[::-1]
    return RefereeFault(
        {"compliance": float(bend.mean() * lever**2)},
        body=lambda m: replace(m, bend=bend, root=root),
    )


@drawn("cable.pull")
def hose(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A hose from a hook above the robot: taut in part of the workspace, pulling about 0.3 N."""
    place = _places(setting)
    spread = max(float(np.linalg.norm(place.std(axis=0))), 0.05)
    aside = rng.normal(0.0, 0.7, 2)
    hook = place.mean(axis=0) + max(1.3 * spread, 0.2) * np.array([*aside, rng.uniform(0.4, 1.4)])
    point = np.array([*rng.normal(0.0, 0.02, 2), rng.uniform(0.0, 0.08)])
    far = np.linalg.norm(place - hook, axis=1)
    slack = float(np.quantile(far, rng.uniform(0.0, 0.6)))
    pull = float(np.mean(np.maximum(far - slack, 0.0))) + 1e-3
    stiffness = about(rng, 0.02 * _stated(setting)[0] * _G * size) / pull
    rope = Hose(hook, point, slack, stiffness)
    true = {"stiffness": stiffness, "slack": slack}
    return RefereeFault(true, body=lambda m: replace(m, hose=rope))


@drawn("environment.contact")
def pad(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Something soft in a corner of the workspace that the tool's end presses on: about 0.4 N."""
    tip = np.array([0.0, 0.0, 1.9 * max(float(_stated(setting)[1][2]), 0.03)])
    rotation, position = setting.robot.sensor_pose(setting.mean(setting.path.q), setting.theta)
    ends = position + rotation @ tip
    normal = np.array([0.0, 0.0, 1.0]) + rng.uniform(0.0, 0.6) * direction(rng)
    normal /= np.linalg.norm(normal)
    height = ends @ normal
    radius = 0.01
    level = float(np.quantile(height, rng.uniform(0.06, 0.2)))
    deep = level - height[height < level]
    force = about(rng, 0.03 * _stated(setting)[0] * _G * size)
    k = force / max(float(deep.mean()), 1e-4)
    point = ends.mean(axis=0) + (level - radius - float(ends.mean(axis=0) @ normal)) * normal
    block = Pad(point, normal, k, float(rng.uniform(0.1, 0.5)), tip, radius)
    return RefereeFault({"stiffness": k}, body=lambda m: replace(m, pad=block))


@drawn("cable.torsion")
def torsion(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A cable wound about the last joint, with dry friction (Dahl) in its jacket."""
    last = setting.path.q.shape[1] - 1
    angle = setting.path.q[:, last]
    spread = max(float(np.std(angle[setting.path.rows])), 0.05)
    k = sign(rng) * about(rng, 6.0 * setting.noise[5] * size) / spread
    middle = float(np.median(angle)) + rng.normal(0.0, 0.3)
    grip, reach = abs(k) * spread * rng.uniform(0.0, 0.15), rng.uniform(0.05, 0.3)
    lean = rng.normal(0.0, 0.06, 2)

    def load(ride: Ride, y: np.ndarray) -> np.ndarray:
        angle = ride.path.q[:, last]
        twist = k * (angle - middle) + grip * dahl(angle, reach)
        torque = np.stack([lean[0] * twist, lean[1] * twist, twist], axis=1)
        return y + np.concatenate([np.zeros_like(torque), torque], axis=1)

    return RefereeFault({"stiffness": k}, load=load)


def loaded(
    setting: RefereeSetting, m: Mechanics, dm: float = 0.0, dc: np.ndarray | float = 0.0
) -> Mechanics:
    """The machine with another mass and CoG of its tool."""
    tool = setting.robot.tool(m.theta)
    centre = np.asarray(tool.cog) + dc
    theta = setting.robot.theta_of_tool(m.theta, float(tool.mass) + dm, centre.tolist())
    return replace(m, theta=theta)


def _stated(setting: RefereeSetting) -> tuple[float, np.ndarray]:
    tool = setting.metadata.tool
    assert tool.mass is not None and tool.cog is not None
    return tool.mass, np.array(tool.cog)


def _pull(ride: Ride, place: np.ndarray) -> np.ndarray:
    """Gravity less acceleration (T, 3) [m/s²] of a point of the tool (3,), in sensor axes."""
    path = ride.path
    if not path.moving:
        return ride.in_sensor(ride.gravity)
    way = ride.position + np.einsum("tij,j->ti", ride.rotation, place)
    speed = np.gradient(way, path.t, axis=0)
    return ride.in_sensor(ride.gravity - np.gradient(speed, path.t, axis=0))


def _places(setting: RefereeSetting) -> np.ndarray:
    q = setting.mean(setting.path.q)
    place = np.asarray(setting.robot.sensor_pose(q, setting.theta)[1])
    return np.broadcast_to(place, (len(q), 3))
