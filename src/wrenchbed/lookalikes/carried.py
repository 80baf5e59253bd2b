"""Imperfections of what the sensor carries: the tool, its parts and the sensor's own weight."""

import numpy as np
from scipy.ndimage import gaussian_filter1d

from wrenchbed.lookalikes.design import Design
from wrenchbed.lookalikes.imperfection import Imperfection
from wrenchbed.lookalikes.memory import relay
from wrenchbed.lookalikes.rigid import Load, Motion

_AXES = 8
"""Directions that are tried until a loose part really falls to and fro."""
_FALL_S = 0.05
"""In motion a loose part takes about this long to fall [s]."""


def mass(design: Design, rng: np.random.Generator, size: float) -> Imperfection:
    """The tool weighs about 2 % more or less than stated."""
    amount = max(0.02 * size * design.load.mass, 2.5 * design.tolerance[0])
    error = float(amount * rng.choice([-1.0, 1.0]))

    def act(load: Load, motion: Motion) -> Load:
        return Load(load.mass + error, load.cog, load.inertia, load.sensor_mass)

    return Imperfection("tool.mass", {"mass": error}, tool=act)


def cog(design: Design, rng: np.random.Generator, size: float) -> Imperfection:
    """The centre of gravity is about 1.5 mm from where it is stated."""
    axis = rng.standard_normal(3)
    amount = max(1.5e-3 * size, 2.5 * design.tolerance[1])
    error = amount * axis / np.linalg.norm(axis)

    def act(load: Load, motion: Motion) -> Load:
        return Load(load.mass, load.cog + error, load.inertia, load.sensor_mass)

    return Imperfection("tool.cog", dict(zip("xyz", error.tolist(), strict=True)), tool=act)


def inertia(design: Design, rng: np.random.Generator, size: float) -> Imperfection:
    """The tool's moments of inertia are about 30 % off, with small products."""
    own = design.load.inertia
    error = 0.3 * size * own * rng.normal(0.0, 1.0, (3, 3))
    typical = float(np.trace(own)) / 3.0
    spread = 0.1 * size * typical * rng.normal(0.0, 1.0, (3, 3)) * (1.0 - np.eye(3))
    error = error + np.diag(0.3 * size * typical * rng.uniform(0.3, 1.0, 3))
    error = (error + error.T) / 2.0 + (spread + spread.T) / 2.0

    def act(load: Load, motion: Motion) -> Load:
        return Load(load.mass, load.cog, load.inertia + error, load.sensor_mass)

    pairs = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
    return Imperfection("tool.inertia", {k: float(error[i]) for k, i in pairs.items()}, tool=act)


def loose(design: Design, rng: np.random.Generator, size: float) -> Imperfection:
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

    def act(load: Load, motion: Motion) -> Load:
        return Load(load.mass, load.cog + shift, load.inertia, load.sensor_mass)

    values = {"travel": travel, "stick": stick, "lean": lean} | dict(
        zip("xyz", axis.tolist(), strict=True)
    )
    return Imperfection("tool.loose", values, tool=act)


def flexure(design: Design, rng: np.random.Generator, size: float) -> Imperfection:
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

    def act(load: Load, motion: Motion) -> Load:
        force = load.mass * motion.felt
        bent = load.cog + force @ matrix.T
        reach = np.linalg.norm(load.cog)
        if reach > 1e-3:  # a bent beam keeps its length
            across_moved = np.linalg.norm(force @ matrix.T, axis=1, keepdims=True)
            bent = bent - along * 0.5 * across_moved**2 / reach
        return Load(load.mass, bent, load.inertia, load.sensor_mass)

    return Imperfection("tool.flexure", {"compliance": base}, tool=act)


def self_weight(design: Design, rng: np.random.Generator, size: float) -> Imperfection:
    """The sensor's own tool side, about 40 g, loads the gauges; invisible beside mass and CoG."""
    own = 0.04 * size * rng.uniform(0.8, 1.25)

    def act(load: Load, motion: Motion) -> Load:
        return Load(load.mass, load.cog, load.inertia, load.sensor_mass + own)

    return Imperfection("tool.self_weight", {"mass": own}, tool=act)
