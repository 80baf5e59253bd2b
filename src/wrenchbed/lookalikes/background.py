"""No robot is perfect: the small imperfections of every family that every case has."""

import numpy as np

from wrenchbed.lookalikes import carried
from wrenchbed.lookalikes.catalogue import EFFECTS
from wrenchbed.lookalikes.design import Design
from wrenchbed.lookalikes.gap import STATED, gap
from wrenchbed.lookalikes.imperfection import Imperfection, Rows, Scaled, World
from wrenchbed.lookalikes.rigid import Load, Motion

SMALLEST, LARGEST = 0.02, 0.45
"""Gap of the whole background."""
_LEFT_OUT = (*STATED, "sensor.saturation", "environment.contact", "timing.stale")
MOST_RISE = 0.25
"""Rise of a channel's row variance by the background's shake, at most."""
_PRESENT = 0.7
"""Chance of each family to be there."""
_TRIES = 6


def nuisance(design: Design, rng: np.random.Generator) -> list[Scaled]:
    """Bias, mass and CoG somewhere within their tolerance, and an unstated sensor weight."""
    mass, cog, bias = design.tolerance
    shift = rng.uniform(-0.9, 0.9, 6) * bias
    heavier = float(rng.uniform(-0.9, 0.9) * mass)
    direction = rng.standard_normal(3)
    off = rng.uniform(0.0, 0.9) * cog * direction / np.linalg.norm(direction)

    def act(load: Load, motion: Motion) -> Load:
        return Load(load.mass + heavier, load.cog + off, load.inertia, load.sensor_mass)

    tool = Imperfection("background", {}, tool=act)
    zero = Imperfection("background", {}, sensor=lambda y: y + shift)
    own = carried.self_weight(design, rng, min(0.1, 0.4 * mass / 0.04))
    return [(tool, 1.0), (zero, 1.0), (own, 1.0)]


def rows(design: Design, rng: np.random.Generator) -> Imperfection:
    """Steps and a shake far below the noise."""
    step = rng.uniform(0.0, 0.4) * design.noise_std
    drawn = EFFECTS["base.vibration"].draw(design, rng, rng.uniform(0.02, 0.2)).rows
    assert drawn is not None and drawn.shake is not None
    rise = float(np.max(np.mean((drawn.shake / design.noise_std) ** 2, axis=0)))
    calm = min(1.0, float(np.sqrt(MOST_RISE / max(rise, 1e-12)))) * drawn.shake
    return Imperfection("background", {}, rows=Rows(np.ones(6), step, calm, drawn.frequency))


def background(world: World, rng: np.random.Generator) -> list[Scaled]:
    """Most families a little wrong at once, within a random total gap; nuisances apart."""
    design = world.design
    target = float(np.exp(rng.uniform(np.log(SMALLEST), np.log(0.9 * LARGEST))))
    around = nuisance(design, rng)
    drawn = []
    for effect in EFFECTS.values():
        if effect.rows or effect.name in _LEFT_OUT or not effect.fits(design):
            continue
        if rng.uniform() > _PRESENT:
            continue
        size = 0.1 * float(np.exp(0.7 * rng.standard_normal()))
        seed = int(rng.integers(2**62))
        drawn.append(effect.draw(design, np.random.default_rng(seed), size))
    scale = 0.5
    for _ in range(_TRIES):
        items = [(item, scale) for item in drawn]
        found = gap(design, world.reading(items) - design.nominal)
        if SMALLEST <= found <= min(1.3 * target, LARGEST):
            break
        scale *= float(np.clip(np.sqrt(0.95 * target / max(found, 1e-12)), 1e-3, 1e3))
    return [*around, *[(item, scale) for item in drawn], (rows(design, rng), 1.0)]
