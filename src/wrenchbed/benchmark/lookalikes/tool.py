"""What else touches the tool: cables that pull and twist, an obstacle, a floor that shakes.

Imperfections of what the sensor carries: the tool, its parts and the sensor's own weight.
"""

import numpy as np
from scipy.ndimage import gaussian_filter1d

from wrenchbed.benchmark.lookalikes.design import ExperimentDesign
from wrenchbed.benchmark.lookalikes.imperfection import Imperfection, RowImperfection, relay
from wrenchbed.benchmark.lookalikes.loads import RigidLoad, SensorMotion, cross, rotate, rotate_back

_AXES = 8
"""Directions that are tried until a loose part really falls to and fro."""
_FALL_S = 0.05
"""In motion a loose part takes about this long to fall [s]."""


def mass(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """The tool weighs about 2 % more or less than stated."""
    amount = max(0.02 * size * design.load.mass, 2.5 * design.tolerance[0])
    error = float(amount * rng.choice([-1.0, 1.0]))

    def act(load: RigidLoad, motion: SensorMotion) -> RigidLoad:
        return RigidLoad(load.mass + error, load.cog, load.inertia, load.sensor_mass)

    return Imperfection("tool.mass", {"mass": error}, tool=act)


def cog(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """The centre of gravity is about 1.5 mm from where it is stated."""
    axis = rng.standard_normal(3)
    amount = max(1.5e-3 * size, 2.5 * design.tolerance[1])
    error = amount * axis / np.linalg.norm(axis)

    def act(load: RigidLoad, motion: SensorMotion) -> RigidLoad:
        return RigidLoad(load.mass, load.cog + error, load.inertia, load.sensor_mass)

    return Imperfection("tool.cog", dict(zip("xyz", error.tolist(), strict=True)), tool=act)


def inertia(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """The tool's moments of inertia are about 30 % off, with small products."""
    own = design.load.inertia
    error = 0.3 * size * own * rng.normal(0.0, 1.0, (3, 3))
    typical = float(np.trace(own)) / 3.0
    spread = 0.1 * size * typical * rng.normal(0.0, 1.0, (3, 3)) * (1.0 - np.eye(3))
    error = error + np.diag(0.3 * size * typical * rng.uniform(0.3, 1.0, 3))
    error = (error + error.T) / 2.0 + (spread + spread.T) / 2.0

    def act(load: RigidLoad, motion: SensorMotion) -> RigidLoad:
        return RigidLoad(load.mass, load.cog, load.inertia + error, load.sensor_mass)

    pairs = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
    return Imperfection("tool.inertia", {k: float(error[i]) for k, i in pairs.items()}, tool=act)


def loose(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """A loose part falls to the other stop, about 1 mm of the CoG, when gravity clearly says so."""
    travel = 1e-3 * size * rng.uniform(0.8, 1.25)
    way = design.path
    for _ in range(_AXES):
        axis = rng.standard_normal(3)
        axis /= np.linalg.norm(axis)
        stick, lean = rng.uniform(0.03, 0.35), rng.normal(0.0, 0.3)
        pull = way.felt @ axis / 9.81 - lean
        state = relay(pull, np.array(-stick), np.array(stick))[way.at]
        if 0.1 < np.mean(state > 0.0) < 0.9:
            break
    if design.moving:
        state = gaussian_filter1d(state, max(1.0, _FALL_S * design.rate))
    shift = 0.5 * travel * state[:, None] * axis

    def act(load: RigidLoad, motion: SensorMotion) -> RigidLoad:
        return RigidLoad(load.mass, load.cog + shift, load.inertia, load.sensor_mass)

    values = {"travel": travel, "stick": stick, "lean": lean} | dict(
        zip("xyz", axis.tolist(), strict=True)
    )
    return Imperfection("tool.loose", values, tool=act)


def flexure(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """The tool bends under its own weight, softer across than along: about 5e-5 m/N."""
    base = 5e-5 * size * rng.uniform(0.8, 1.25)
    along = design.load.cog / max(float(np.linalg.norm(design.load.cog)), 1e-9)
    stiff = rng.uniform(0.05, 0.3)
    turn = rng.uniform(0.6, 1.0)
    side = np.cross(along, rng.standard_normal(3))
    side /= np.linalg.norm(side)
    across = np.eye(3) - np.outer(along, along)
    matrix = base * (turn * across + (1.0 - turn) * np.outer(side, side))
    matrix = matrix + base * stiff * np.outer(along, along)

    def act(load: RigidLoad, motion: SensorMotion) -> RigidLoad:
        force = load.mass * motion.felt
        bent = load.cog + force @ matrix.T
        reach = np.linalg.norm(load.cog)
        if reach > 1e-3:  # a bent beam keeps its length
            across_moved = np.linalg.norm(force @ matrix.T, axis=1, keepdims=True)
            bent = bent - along * 0.5 * across_moved**2 / reach
        return RigidLoad(load.mass, bent, load.inertia, load.sensor_mass)

    return Imperfection("tool.flexure", {"compliance": base}, tool=act)


def self_weight(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """The sensor's own tool side, about 40 g, loads the gauges; invisible beside mass and CoG."""
    own = 0.04 * size * rng.uniform(0.8, 1.25)

    def act(load: RigidLoad, motion: SensorMotion) -> RigidLoad:
        return RigidLoad(load.mass, load.cog, load.inertia, load.sensor_mass + own)

    return Imperfection("tool.self_weight", {"mass": own}, tool=act)


def cable_pull(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """A hose between a hook in the world and the tool pulls once it is taut: about 0.2 N."""
    point = np.array([rng.normal(0.0, 0.02), rng.normal(0.0, 0.02), rng.uniform(0.02, 0.1)])
    place = design.motion.position
    middle, spread = place.mean(axis=0), float(np.linalg.norm(place.std(axis=0)))
    reach = max(1.5 * spread, 0.2)
    hook = middle + reach * np.array(
        [rng.normal(0, 0.6), rng.normal(0, 0.6), rng.uniform(0.5, 1.5)]
    )
    far = np.linalg.norm(place - hook, axis=1)
    slack = float(np.quantile(far, rng.uniform(0.0, 0.6))) * rng.uniform(0.7, 1.0)
    typical = 0.012 * design.load.mass * 9.81
    stretch = max(float(np.sqrt(np.mean(np.maximum(far - slack, 0.0) ** 2))), 1e-3)
    stiffness = typical * size / stretch * rng.uniform(0.8, 1.25)
    power = rng.uniform(0.9, 1.2)

    def act(motion: SensorMotion, load: RigidLoad) -> np.ndarray:
        tied = motion.position + rotate(motion.rotation, np.broadcast_to(point, place.shape))
        line = hook - tied
        length = np.linalg.norm(line, axis=1, keepdims=True)
        taut = np.maximum(length - slack, 0.0)
        pull = stiffness * stretch * (taut / stretch) ** power * line / length
        force = rotate_back(motion.rotation, pull)
        return np.concatenate([force, cross(np.broadcast_to(point, place.shape), force)], axis=1)

    values = {"stiffness": stiffness, "slack": slack}
    values |= {f"hook_{a}": float(h) for a, h in zip("xyz", hook, strict=True)}
    values |= {f"point_{a}": float(p) for a, p in zip("xyz", point, strict=True)}
    return Imperfection("cable.pull", values, load=act)


def cable_torsion(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """A cable wound with the last joint twists the tool, with some friction: 1 % of its torque."""
    way, last = design.path, design.q.shape[1] - 1
    angle = way.q[:, last]
    middle = float(np.median(angle)) + rng.normal(0.0, 0.3)
    range_ = max(float(np.std(angle)), 0.05)
    typical = 8.0 * design.noise_std[5]
    stiffness = typical * size / range_ * rng.uniform(0.8, 1.25)
    turned = np.diff(angle, prepend=angle[0])
    side = relay(turned, np.array(-1e-4), np.array(1e-4))
    loop = rng.uniform(0.0, 0.15) * stiffness * range_
    twist = stiffness * (angle - middle) + loop * side
    lean = rng.normal(0.0, 0.08, 2)
    values = {"stiffness": float(rng.choice([-1.0, 1.0]) * stiffness), "middle": middle}
    values["friction"] = loop
    sign = np.sign(values["stiffness"])
    torque = (sign * twist[way.at])[:, None] * np.array([lean[0], lean[1], 1.0])

    def act(motion: SensorMotion, load: RigidLoad) -> np.ndarray:
        return np.concatenate([np.zeros_like(torque), torque], axis=1)

    return Imperfection("cable.torsion", values, load=act)


def contact(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """The tool's end presses on an obstacle in one corner of the workspace: about 0.3 N."""
    tip = np.array([0.0, 0.0, 2.0 * max(float(design.load.cog[2]), 0.03)])
    lever = np.broadcast_to(tip, (len(design), 3))
    way = design.motion
    ends = way.position + rotate(way.rotation, lever)
    normal = rng.standard_normal(3)
    if rng.uniform() < 0.5:  # a table
        normal = np.array([0.0, 0.0, 1.0]) + 0.1 * normal
    normal /= np.linalg.norm(normal)
    height = ends @ normal
    level = float(np.quantile(height, rng.uniform(0.05, 0.25)))
    deep = np.maximum(level - height, 0.0)
    mean = max(float(deep[deep > 0].mean()), 1e-5) if (deep > 0).any() else 1e-3
    typical = 0.025 * design.load.mass * 9.81
    power = rng.uniform(1.0, 1.5)
    force_at = typical * size * rng.uniform(0.8, 1.25)
    rub = rng.uniform(0.0, 0.3)
    way_along = np.cross(normal, rng.standard_normal(3))
    way_along /= np.linalg.norm(way_along)

    def act(motion: SensorMotion, load: RigidLoad) -> np.ndarray:
        at = motion.position + rotate(motion.rotation, lever)
        depth = np.maximum(level - at @ normal, 0.0) / mean
        push = (force_at * depth**power)[:, None] * (normal + rub * way_along)
        force = rotate_back(motion.rotation, push)
        return np.concatenate([force, cross(lever, force)], axis=1)

    values = {"stiffness": force_at / mean, "level": level, "power": power, "friction": rub}
    values |= {f"normal_{a}": float(n) for a, n in zip("xyz", normal, strict=True)}
    return Imperfection("environment.contact", values, load=act)


def vibration(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """The floor shakes the base along one axis, a line between 5 and 45 Hz or broad."""
    axis = rng.standard_normal(3) * [1.0, 1.0, 0.6]
    axis /= np.linalg.norm(axis)
    noise = float(np.min(design.noise_std[:3]))
    level = 1.2 * noise / design.load.mass * size * rng.uniform(0.8, 1.25)  # m/s² rms
    top = 0.45 * design.rate
    narrow = rng.uniform() < 0.75
    frequency = float(rng.uniform(min(5.0, 0.3 * top), min(45.0, top))) if narrow else 0.0
    felt = rotate_back(design.motion.rotation, np.broadcast_to(-level * axis, (len(design), 3)))
    force = design.load.mass * felt
    torque = cross(np.broadcast_to(design.load.cog, force.shape), force)
    shake = np.concatenate([force, torque], axis=1)
    values = {"acceleration": level, "frequency": frequency}
    values |= dict(zip("xyz", axis.tolist(), strict=True))
    return Imperfection(
        "base.vibration", values, rows=RowImperfection(shake=shake, frequency=frequency)
    )
