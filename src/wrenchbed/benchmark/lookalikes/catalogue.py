"""The effects that a design can show, and the small imperfections that every case has.

Typical sizes and ranges are estimates.
"""

from dataclasses import replace

import numpy as np

from wrenchbed.benchmark.lookalikes import arm, sensor, tool
from wrenchbed.benchmark.lookalikes import sensor as timing
from wrenchbed.benchmark.lookalikes.design import ExperimentDesign
from wrenchbed.benchmark.lookalikes.imperfection import (
    DRAWN,
    STATED,
    Imperfection,
    ImperfectRobot,
    LookalikeEffect,
    Rng,
    RowImperfection,
    Scaled,
    gap,
)

FILES = (arm, sensor, timing, tool)
"""Modules whose draws are registered by importing them."""
_SUBSYSTEMS = (
    "sensor", "mount", "tool", "cable", "joint", "link", "base", "timing", "environment",
)  # fmt: skip
"""Order in which effects are drawn: cases follow from it and the seed."""
EFFECTS = dict(sorted(DRAWN.items(), key=lambda e: _SUBSYSTEMS.index(e[0].partition(".")[0])))
"""Every effect by name."""
LARGEST = 8.0
"""Largest size of a cause in multiples of typical."""
_PROBES = 4
"""Draws that find out whether a design shows an effect."""
_PROBED_GAP = 1.3
"""Gap that one of them must reach: an estimate."""
SMALLEST_BACKGROUND, LARGEST_BACKGROUND = 0.02, 0.45
"""Gap of all small imperfections together."""
MOST_RISE = 0.25
"""Rise of a channel's row variance by the background's vibration, at most."""
_NOT_IN_BACKGROUND = (*STATED, "sensor.saturation", "environment.contact", "timing.stale")
_PRESENT = 0.7
"""Chance of each effect to be in the background."""
_TRIES = 6
"""Scalings of a background."""


def effects(design: ExperimentDesign) -> tuple[str, ...]:
    """Names of the effects that can be drawn for a design: those that can show in it."""

    def shown() -> tuple[str, ...]:
        fitting = [e for e in EFFECTS.values() if e.fits(design)]
        return tuple(e.name for e in fitting if not e.hard or _shows(design, e))

    return design.once("effects", shown)


def _shows(design: ExperimentDesign, effect: LookalikeEffect) -> bool:
    """Whether one of a few large draws reaches a gap that counts."""
    robot = ImperfectRobot(design)
    for probe in range(_PROBES):
        item = effect.draw(design, np.random.default_rng([probe, 7]), 0.8 * LARGEST)
        with np.errstate(invalid="ignore"):
            difference = robot.reading([(item, 1.0)]) - design.nominal
        if np.isfinite(difference).all() and gap(design, difference) > _PROBED_GAP:
            return True
    return False


def background(robot: ImperfectRobot, rng: Rng) -> list[Scaled]:
    """Most effects at once, small, within a random total gap; and errors within tolerance."""
    design = robot.design
    target = float(
        np.exp(rng.uniform(np.log(SMALLEST_BACKGROUND), np.log(0.9 * LARGEST_BACKGROUND)))
    )
    around = _within_tolerance(design, rng)
    drawn = []
    for effect in EFFECTS.values():
        if effect.rows or effect.name in _NOT_IN_BACKGROUND or not effect.fits(design):
            continue
        if rng.uniform() > _PRESENT:
            continue
        size = 0.1 * float(np.exp(0.7 * rng.standard_normal()))
        seed = int(rng.integers(2**62))
        drawn.append(effect.draw(design, np.random.default_rng(seed), size))
    scale = 0.5
    for _ in range(_TRIES):
        reading = robot.reading([(item, scale) for item in drawn])
        reached = gap(design, reading - design.nominal)
        if SMALLEST_BACKGROUND <= reached <= min(1.3 * target, LARGEST_BACKGROUND):
            break
        scale *= float(np.clip(np.sqrt(0.95 * target / max(reached, 1e-12)), 1e-3, 1e3))
    return [*around, *[(item, scale) for item in drawn], (_between_rows(design, rng), 1.0)]


def _within_tolerance(design: ExperimentDesign, rng: Rng) -> list[Scaled]:
    """Errors of bias, mass and CoG within their tolerance, and an unstated sensor weight."""
    mass, cog, bias = design.tolerance
    shift = rng.uniform(-0.9, 0.9, 6) * bias
    heavier = float(rng.uniform(-0.9, 0.9) * mass)
    direction = rng.standard_normal(3)
    off = rng.uniform(0.0, 0.9) * cog * direction / np.linalg.norm(direction)
    load = Imperfection(
        name="background",
        tool=lambda load, _: replace(load, mass=load.mass + heavier, cog=load.cog + off),
    )
    zero = Imperfection(name="background", sensor=lambda y: y + shift)
    weight = tool.self_weight(design, rng, min(0.1, 0.4 * mass / 0.04))
    return [(load, 1.0), (zero, 1.0), (weight, 1.0)]


def _between_rows(design: ExperimentDesign, rng: Rng) -> Imperfection:
    """Quantization and vibration far below the noise."""
    step = rng.uniform(0.0, 0.4) * design.noise_std
    drawn = arm.vibration(design, rng, rng.uniform(0.02, 0.2)).rows
    assert drawn is not None and drawn.shake is not None
    rise = float(np.max(np.mean((drawn.shake / design.noise_std) ** 2, axis=0)))
    shake = min(1.0, float(np.sqrt(MOST_RISE / max(rise, 1e-12)))) * drawn.shake
    rows = RowImperfection(np.ones(6), step, shake, drawn.frequency)
    return Imperfection(name="background", rows=rows)
