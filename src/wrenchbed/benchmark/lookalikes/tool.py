"""Imperfections of what the sensor carries: tool, loose parts, cables, contact with an obstacle.

Typical sizes and ranges are estimates.
"""

from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from wrenchbed.benchmark.frame import Rng, by_axis, by_moment, elapsed
from wrenchbed.benchmark.lookalikes import loads
from wrenchbed.benchmark.lookalikes.design import ExperimentDesign
from wrenchbed.benchmark.lookalikes.imperfection import Imperfection, heavier, off, relay, spread
from wrenchbed.benchmark.lookalikes.loads import SensorMotion
from wrenchbed.physics.wrench import Tool

_AXES = 8
"""Directions that are tried until a loose part really moves to and fro."""
_FALL_S = 0.05
"""In motion a loose part takes about this long to change sides [s]: an estimate."""
_G = 9.81
"""Gravity for typical forces [m/s²]: an estimate."""


def tool_mass(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """The tool weighs about 2 % more or less than stated."""
    amount = max(0.02 * size * design.load.mass, 2.5 * design.tolerance[0])
    return heavier(float(amount * rng.choice([-1.0, 1.0])))


def tool_cog(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """The centre of gravity is about 1.5 mm from where it is stated."""
    axis = rng.standard_normal(3)
    amount = max(1.5e-3 * size, 2.5 * design.tolerance[1])
    return off(amount * axis / np.linalg.norm(axis))


def tool_inertia(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """The tool's moments of inertia are about 30 % off, with small products."""
    stated = design.load.inertia
    error = 0.3 * size * stated * rng.normal(0.0, 1.0, (3, 3))
    typical = float(np.trace(stated)) / 3.0
    products = 0.1 * size * typical * rng.normal(0.0, 1.0, (3, 3)) * (1.0 - np.eye(3))
    error = error + np.diag(0.3 * size * typical * rng.uniform(0.3, 1.0, 3))
    error = (error + error.T) / 2.0 + (products + products.T) / 2.0
    return Imperfection(
        by_moment(error), tool=lambda load, _: replace(load, inertia=load.inertia + error)
    )


def tool_loose(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """A loose part shifts the CoG by about 1 mm when gravity clearly pulls it to the other stop."""
    travel = 1e-3 * size * spread(rng)
    path = design.path
    for _ in range(_AXES):
        axis = rng.standard_normal(3)
        axis /= np.linalg.norm(axis)
        stick, lean = rng.uniform(0.03, 0.35), rng.normal(0.0, 0.3)
        pull = path.specific_force @ axis / _G - lean
        state = relay(pull, np.array(-stick), np.array(stick))[path.at]
        if 0.1 < np.mean(state > 0.0) < 0.9:
            break
    if design.moving:
        state = gaussian_filter1d(state, max(1.0, _FALL_S * design.rate))
    values = {"travel": travel, "stick": stick, "lean": lean} | by_axis(axis)
    return off(0.5 * travel * state[:, None] * axis, values)


def tool_leak(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """About 1.5 % of the mass runs out by Torricelli's law or a power of time, or falls off."""
    progress = elapsed(design.t)
    kind = rng.choice(["tank", "power", "part"], p=[0.4, 0.4, 0.2])
    if kind == "tank":  # its level falls; it is empty at about the end or later
        level = np.maximum(1.0 - progress / rng.uniform(0.9, 2.5), 0.0) ** 2
        law = (1.0 - level) / (1.0 - level[-1])
    elif kind == "power":
        law = progress ** rng.uniform(0.7, 1.8)
    else:
        law = (progress > rng.uniform(0.2, 0.8)).astype(float)
    lost = 0.015 * size * design.load.mass * spread(rng) * float(rng.choice([1.0, 1.0, 1.0, -1.0]))
    place = design.load.cog + rng.normal(0.0, 0.02, 3)

    return Imperfection(
        {"lost": float(lost)},
        load=lambda m, _: loads.wrench_at(place, -lost * law[:, None] * m.specific_force),
    )


def tool_slide(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """The CoG moves by about 2 mm: a clamp creeps, slips in steps, or the tool bows as it warms."""
    progress = elapsed(design.t)
    kind = rng.choice(["creeps", "slips", "bows"])
    if kind == "creeps":
        slow = rng.uniform(0.03, 0.5)
        law = np.log1p(progress / slow) / np.log1p(1.0 / slow)
    elif kind == "slips":
        steps = rng.gamma(2.0, 1.0, int(rng.integers(12, 40)))
        when = np.sort(rng.uniform(0.0, 1.0, len(steps)))
        law = np.append(0.0, np.cumsum(steps))[np.searchsorted(when, progress)] / steps.sum()
    else:
        fast, slow = rng.uniform(0.05, 0.2), rng.uniform(0.3, 0.8)
        law = np.exp(-progress / slow) - np.exp(-progress / fast)
        law = law / np.abs(law).max()
    axis = rng.standard_normal(3)
    amount = 2e-3 * size * spread(rng)
    return off(amount * law[:, None] * axis / np.linalg.norm(axis), {"moved": amount})


def tool_flexure(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """The tool bends under its own weight, softer across than along: about 5e-5 m/N."""
    base = 5e-5 * size * spread(rng)
    along = design.load.cog / max(float(np.linalg.norm(design.load.cog)), 1e-9)
    stiff = rng.uniform(0.05, 0.3)
    even = rng.uniform(0.6, 1.0)
    side = np.cross(along, rng.standard_normal(3))
    side /= np.linalg.norm(side)
    across = np.eye(3) - np.outer(along, along)
    matrix = base * (even * across + (1.0 - even) * np.outer(side, side))
    matrix = matrix + base * stiff * np.outer(along, along)

    def act(load: Tool, motion: SensorMotion) -> Tool:
        force = load.mass * motion.specific_force
        deflection = force @ matrix.T
        bent = load.cog + deflection
        reach = np.linalg.norm(load.cog)
        if reach > 1e-3:  # a bent beam keeps its length
            length = np.linalg.norm(deflection, axis=1, keepdims=True)
            bent = bent - along * 0.5 * length**2 / reach
        return replace(load, cog=bent)

    return Imperfection({"compliance": base}, tool=act)


def cable_pull(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """A hose between a hook in the world and the tool pulls once it is taut: about 0.2 N."""
    point = np.array([rng.normal(0.0, 0.02), rng.normal(0.0, 0.02), rng.uniform(0.02, 0.1)])
    place = design.motion.position
    reach = max(1.5 * float(np.linalg.norm(place.std(axis=0))), 0.2)
    aside = [rng.normal(0, 0.6), rng.normal(0, 0.6), rng.uniform(0.5, 1.5)]
    hook = place.mean(axis=0) + reach * np.array(aside)
    far = np.linalg.norm(place - hook, axis=1)
    slack = float(np.quantile(far, rng.uniform(0.0, 0.6))) * rng.uniform(0.7, 1.0)
    typical = 0.012 * design.load.mass * _G
    stretch = max(float(np.sqrt(np.mean(np.maximum(far - slack, 0.0) ** 2))), 1e-3)
    stiffness = typical * size / stretch * spread(rng)
    power = rng.uniform(0.9, 1.2)
    lever = np.broadcast_to(point, place.shape)

    def act(motion: SensorMotion, load: Tool) -> np.ndarray:
        line = hook - (motion.position + loads.rotate(motion.rotation, lever))
        length = np.linalg.norm(line, axis=1, keepdims=True)
        taut = np.maximum(length - slack, 0.0)
        pull = stiffness * stretch * (taut / stretch) ** power * line / length
        return loads.wrench_at(lever, loads.rotate_back(motion.rotation, pull))

    values = {"stiffness": float(stiffness), "slack": float(slack)}
    return Imperfection(values | by_axis(hook, "hook_") | by_axis(point, "point_"), load=act)


def cable_torsion(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """A cable wound with the last joint twists the tool, with some friction: 1 % of its torque."""
    path, last = design.path, design.q.shape[1] - 1
    angle = path.q[:, last]
    middle = float(np.median(angle)) + rng.normal(0.0, 0.3)
    spread_of_angle = max(float(np.std(angle)), 0.05)
    typical = 8.0 * design.noise_std[5]
    stiffness = typical * size / spread_of_angle * spread(rng)
    side = relay(np.diff(angle, prepend=angle[0]), np.array(-1e-4), np.array(1e-4))
    loop = rng.uniform(0.0, 0.15) * stiffness * spread_of_angle
    twist = stiffness * (angle - middle) + loop * side
    lean = rng.normal(0.0, 0.08, 2)
    values = {"stiffness": float(rng.choice([-1.0, 1.0]) * stiffness), "middle": middle}
    values["friction"] = loop
    sign = np.sign(values["stiffness"])
    torque = (sign * twist[path.at])[:, None] * np.array([lean[0], lean[1], 1.0])
    wrench = np.concatenate([np.zeros_like(torque), torque], axis=1)
    return Imperfection(values, load=lambda motion, load: wrench)


def environment_contact(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """The tool's end presses on an obstacle in one corner of the workspace: about 0.3 N."""
    tip = np.array([0.0, 0.0, 2.0 * max(float(design.load.cog[2]), 0.03)])
    lever = np.broadcast_to(tip, (len(design), 3))
    ends = design.motion.position + loads.rotate(design.motion.rotation, lever)
    normal = rng.standard_normal(3)
    if rng.uniform() < 0.5:  # a table
        normal = np.array([0.0, 0.0, 1.0]) + 0.1 * normal
    normal /= np.linalg.norm(normal)
    height = ends @ normal
    level = float(np.quantile(height, rng.uniform(0.05, 0.25)))
    deep = np.maximum(level - height, 0.0)
    mean = max(float(deep[deep > 0].mean()), 1e-5) if (deep > 0).any() else 1e-3
    typical = 0.025 * design.load.mass * _G
    power = rng.uniform(1.0, 1.5)
    force = typical * size * spread(rng)
    friction = rng.uniform(0.0, 0.3)
    along = np.cross(normal, rng.standard_normal(3))
    along /= np.linalg.norm(along)

    def act(motion: SensorMotion, load: Tool) -> np.ndarray:
        at = motion.position + loads.rotate(motion.rotation, lever)
        depth = np.maximum(level - at @ normal, 0.0) / mean
        push = (force * depth**power)[:, None] * (normal + friction * along)
        return loads.wrench_at(lever, loads.rotate_back(motion.rotation, push))

    values = {"stiffness": float(force / mean), "level": float(level)}
    values |= {"power": float(power), "friction": float(friction)}
    return Imperfection(values | by_axis(normal, "normal_"), load=act)
