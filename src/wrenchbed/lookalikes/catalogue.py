"""The effects that can be drawn: the contract's names, and where each makes sense."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wrenchbed.lookalikes import arm, carried, sensor, surroundings, timing
from wrenchbed.lookalikes.design import Design
from wrenchbed.lookalikes.gap import gap
from wrenchbed.lookalikes.imperfection import Imperfection, World

Drawer = Callable[[Design, np.random.Generator, float], Imperfection]
"""Draws one imperfection of a size in multiples of typical."""


@dataclass(frozen=True)
class Effect:
    """One effect of the contract.

    Attributes:
        name: the contract's.
        draw: its generator.
        fits: whether a design can show it at all.
        rows: it shows between rows: what counts is the variance of a row, not the gap.
        hard: it often shows too little: whether it can is tried out once for each design.
    """

    name: str
    draw: Drawer
    fits: Callable[[Design], bool]
    rows: bool = False
    hard: bool = False


LARGEST = 8.0
"""Largest size of a cause in multiples of typical."""
_PROBES = 4
_PROBED = 1.3
_CACHE = "_lookalike_effects"


def _always(design: Design) -> bool:
    return True


def _moving(design: Design) -> bool:
    return design.moving


def _jointed(design: Design) -> bool:
    return design.has_joints


def _five_bars(design: Design) -> bool:
    return design.has_joints and bool(arm.distal_links(design))


def _never(design: Design) -> bool:
    return False


def _repeats(design: Design) -> bool:
    return design.moving or design.samples >= 4


_LIST = (
    Effect("sensor.bias", sensor.bias, _always),
    Effect("sensor.drift", sensor.drift, _always),
    Effect("sensor.gain", sensor.gain, _always),
    Effect("sensor.crosstalk", sensor.crosstalk, _always),
    Effect("sensor.hysteresis", sensor.hysteresis, _always),
    Effect("sensor.saturation", sensor.saturation, _always),
    Effect("sensor.quantization", sensor.quantization, _repeats, rows=True),
    Effect("sensor.noise", sensor.noise, _repeats, rows=True),
    Effect("sensor.temperature", sensor.temperature, _always),
    Effect("sensor.nonlinearity", sensor.nonlinearity, _always),
    Effect("sensor.creep", sensor.creep, _always, hard=True),
    Effect("sensor.jump", sensor.jump, _always),
    Effect("mount.rotation", arm.mount_rotation, _always),
    Effect("tool.mass", carried.mass, _always),
    Effect("tool.cog", carried.cog, _always),
    Effect("tool.inertia", carried.inertia, _moving, hard=True),
    Effect("tool.loose", carried.loose, _always, hard=True),
    Effect("tool.flexure", carried.flexure, _always, hard=True),
    Effect("tool.self_weight", carried.self_weight, _never),
    Effect("cable.pull", surroundings.cable_pull, _jointed),
    Effect("cable.torsion", surroundings.cable_torsion, _jointed),
    Effect("joint.offset", arm.offset, _jointed),
    Effect("joint.compliance", arm.compliance, _jointed, hard=True),
    Effect("joint.backlash", arm.backlash, _jointed, hard=True),
    Effect("joint.gear_error", arm.gear_error, _jointed, hard=True),
    Effect("joint.clearance", arm.clearance, _five_bars, hard=True),
    Effect("link.length", arm.link_length, _five_bars),
    Effect("base.tilt", arm.tilt, _always),
    Effect("base.compliance", arm.base_compliance, _jointed, hard=True),
    Effect("base.vibration", surroundings.vibration, _repeats, rows=True),
    Effect("timing.delay", timing.delay, _moving),
    Effect("timing.lowpass", timing.lowpass, _moving),
    Effect("timing.stale", timing.stale, _moving, rows=True),
    Effect("timing.skew", timing.skew, _moving),
    Effect("environment.contact", surroundings.contact, _jointed),
)
EFFECTS = {e.name: e for e in _LIST}
"""Every effect by name; ``tool.self_weight`` is exactly a mass and CoG, so only background."""


def effects(design: Design) -> tuple[str, ...]:
    """Names of the effects that can be drawn for a design: those that can show in it."""
    if _CACHE not in design.__dict__:
        fitting = [e for e in _LIST if e.fits(design)]
        shown = tuple(e.name for e in fitting if not e.hard or _shows(design, e))
        design.__dict__[_CACHE] = shown
    return tuple(design.__dict__[_CACHE])


def _shows(design: Design, effect: Effect) -> bool:
    """Whether one of a few large draws reaches a gap that counts."""
    world = World(design)
    for probe in range(_PROBES):
        item = effect.draw(design, np.random.default_rng([probe, 7]), 0.8 * LARGEST)
        with np.errstate(invalid="ignore"):
            difference = world.reading([(item, 1.0)]) - design.nominal
        if np.isfinite(difference).all() and gap(design, difference) > _PROBED:
            return True
    return False
