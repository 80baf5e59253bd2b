"""The effects that can be drawn: the contract's names, and where each makes sense.

No robot is perfect: the small imperfections of every family that every case has.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from wrenchbed.benchmark.lookalikes import arm, sensor, tool
from wrenchbed.benchmark.lookalikes import sensor as timing
from wrenchbed.benchmark.lookalikes import tool as carried
from wrenchbed.benchmark.lookalikes.design import ExperimentDesign
from wrenchbed.benchmark.lookalikes.imperfection import (
    STATED,
    Imperfection,
    ImperfectRobot,
    RowImperfection,
    Scaled,
    gap,
)
from wrenchbed.benchmark.lookalikes.loads import RigidLoad, SensorMotion
from wrenchbed.physics.wrench import CHANNELS

Drawer = Callable[[ExperimentDesign, np.random.Generator, float], Imperfection]
"""Draws one imperfection of a size in multiples of typical."""
Names = Callable[[Mapping[str, float]], dict[str, float]]
"""True values under the names that a diagnosis publishes."""


@dataclass(frozen=True)
class LookalikeEffect:
    """One effect of the contract.

    Attributes:
        name: the contract's.
        draw: its generator.
        fits: whether a design can show it at all.
        rows: it shows between rows: what counts is the variance of a row, not the gap.
        hard: it often shows too little: whether it can is tried out once for each design.
        published: its true values under the names that a diagnosis publishes, where both physics
            mean the same numbers.
        adds: its numbers add up with those of the background's share of the same effect.
    """

    name: str
    draw: Drawer
    fits: Callable[[ExperimentDesign], bool]
    rows: bool = False
    hard: bool = False
    published: Names | None = None
    adds: bool = True


LARGEST = 8.0
"""Largest size of a cause in multiples of typical."""
_PROBES = 4
_PROBED = 1.3
_CACHE = "_lookalike_effects"


def _always(design: ExperimentDesign) -> bool:
    return True


def _moving(design: ExperimentDesign) -> bool:
    return design.moving


def _jointed(design: ExperimentDesign) -> bool:
    return design.has_joints


def _five_bars(design: ExperimentDesign) -> bool:
    return design.has_joints and bool(arm.distal_links(design))


def _never(design: ExperimentDesign) -> bool:
    return False


def _repeats(design: ExperimentDesign) -> bool:
    return design.moving or design.samples >= 4


def _prefixed(stem: str) -> Names:
    return lambda v: {f"{stem}.{k}": x for k, x in v.items() if k in CHANNELS}


def _axes(stem: str) -> Names:
    return lambda v: {f"{stem}{k}": x for k, x in v.items()}


def _pairs(v: Mapping[str, float]) -> dict[str, float]:
    return {"x." + k.replace("_", "."): x for k, x in v.items()}


def _jump(v: Mapping[str, float]) -> dict[str, float]:
    return {"time": v["time"]} | _prefixed("step")(v)


def _offsets(v: Mapping[str, float]) -> dict[str, float]:
    return {f"offset.q{j}": v["offset" + end] for end, j in _joints(v)}


def _compliances(v: Mapping[str, float]) -> dict[str, float]:
    return {f"compliance.q{j}": 1.0 / v["stiffness" + end] for end, j in _joints(v)}


def _joints(v: Mapping[str, float]) -> list[tuple[str, int]]:
    """Ends of the names that belong to a joint, and the joint's number."""
    return [(k.removeprefix("joint"), int(x)) for k, x in v.items() if k.startswith("joint")]


def _skew(v: Mapping[str, float]) -> dict[str, float]:
    # there the sensor's clock is ahead, in the library its readings are late
    return {"skew": -v["rate"]} if "rate" in v else {"channel": v["channel"]}


_LIST = (
    LookalikeEffect("sensor.bias", sensor.bias, _always),
    LookalikeEffect("sensor.drift", sensor.drift, _always, published=_prefixed("rate")),
    LookalikeEffect("sensor.gain", sensor.gain, _always, published=_prefixed("gain")),
    LookalikeEffect(
        "sensor.crosstalk",
        sensor.crosstalk,
        _always,
        published=_pairs,
    ),
    LookalikeEffect("sensor.hysteresis", sensor.hysteresis, _always),
    LookalikeEffect("sensor.saturation", sensor.saturation, _always),
    LookalikeEffect("sensor.quantization", sensor.quantization, _repeats, rows=True),
    LookalikeEffect("sensor.noise", sensor.noise, _repeats, rows=True),
    LookalikeEffect("sensor.temperature", sensor.temperature, _always),
    LookalikeEffect("sensor.nonlinearity", sensor.nonlinearity, _always),
    LookalikeEffect("sensor.creep", sensor.creep, _always, hard=True),
    LookalikeEffect(
        "sensor.jump",
        sensor.jump,
        _always,
        published=_jump,
        adds=False,
    ),
    LookalikeEffect("mount.rotation", arm.mount_rotation, _always, published=_axes("rotation.")),
    LookalikeEffect("tool.mass", tool.mass, _always),
    LookalikeEffect("tool.cog", tool.cog, _always),
    LookalikeEffect("tool.inertia", tool.inertia, _moving, hard=True, published=_axes("inertia.")),
    LookalikeEffect("tool.loose", tool.loose, _always, hard=True),
    LookalikeEffect("tool.flexure", tool.flexure, _always, hard=True),
    LookalikeEffect("tool.self_weight", tool.self_weight, _never),
    LookalikeEffect("cable.pull", tool.cable_pull, _jointed),
    LookalikeEffect("cable.torsion", tool.cable_torsion, _jointed),
    LookalikeEffect("joint.offset", arm.offset, _jointed, published=_offsets),
    LookalikeEffect(
        "joint.compliance",
        arm.compliance,
        _jointed,
        hard=True,
        published=_compliances,
        adds=False,
    ),
    LookalikeEffect("joint.backlash", arm.backlash, _jointed, hard=True),
    LookalikeEffect("joint.gear_error", arm.gear_error, _jointed, hard=True),
    LookalikeEffect("joint.clearance", arm.clearance, _five_bars, hard=True),
    LookalikeEffect("link.length", arm.link_length, _five_bars, published=_axes("length.")),
    LookalikeEffect("base.tilt", arm.tilt, _always, published=_axes("")),
    LookalikeEffect("base.compliance", arm.base_compliance, _jointed, hard=True),
    LookalikeEffect("base.vibration", tool.vibration, _repeats, rows=True),
    LookalikeEffect("timing.delay", timing.delay, _moving, published=_axes("")),
    LookalikeEffect("timing.lowpass", timing.lowpass, _moving),
    LookalikeEffect("timing.stale", timing.stale, _moving, rows=True),
    LookalikeEffect("timing.skew", timing.skew, _moving, published=_skew),
    LookalikeEffect("environment.contact", tool.contact, _jointed),
)
EFFECTS = {e.name: e for e in _LIST}
"""Every effect by name; ``tool.self_weight`` is exactly a mass and CoG, so only background."""


def effects(design: ExperimentDesign) -> tuple[str, ...]:
    """Names of the effects that can be drawn for a design: those that can show in it."""
    if _CACHE not in design.__dict__:
        fitting = [e for e in _LIST if e.fits(design)]
        shown = tuple(e.name for e in fitting if not e.hard or _shows(design, e))
        design.__dict__[_CACHE] = shown
    return tuple(design.__dict__[_CACHE])


def _shows(design: ExperimentDesign, effect: LookalikeEffect) -> bool:
    """Whether one of a few large draws reaches a gap that counts."""
    world = ImperfectRobot(design)
    for probe in range(_PROBES):
        item = effect.draw(design, np.random.default_rng([probe, 7]), 0.8 * LARGEST)
        with np.errstate(invalid="ignore"):
            difference = world.reading([(item, 1.0)]) - design.nominal
        if np.isfinite(difference).all() and gap(design, difference) > _PROBED:
            return True
    return False


SMALLEST_IMPERFECTION, LARGEST_IMPERFECTION = 0.02, 0.45
"""Gap of the whole background."""
_LEFT_OUT = (*STATED, "sensor.saturation", "environment.contact", "timing.stale")
MOST_RISE = 0.25
"""Rise of a channel's row variance by the background's shake, at most."""
_PRESENT = 0.7
"""Chance of each family to be there."""
_TRIES = 6


def nuisance(design: ExperimentDesign, rng: np.random.Generator) -> list[Scaled]:
    """Bias, mass and CoG somewhere within their tolerance, and an unstated sensor weight."""
    mass, cog, bias = design.tolerance
    shift = rng.uniform(-0.9, 0.9, 6) * bias
    heavier = float(rng.uniform(-0.9, 0.9) * mass)
    direction = rng.standard_normal(3)
    off = rng.uniform(0.0, 0.9) * cog * direction / np.linalg.norm(direction)

    def act(load: RigidLoad, motion: SensorMotion) -> RigidLoad:
        return RigidLoad(load.mass + heavier, load.cog + off, load.inertia, load.sensor_mass)

    tool = Imperfection("background", {}, tool=act)
    zero = Imperfection("background", {}, sensor=lambda y: y + shift)
    own = carried.self_weight(design, rng, min(0.1, 0.4 * mass / 0.04))
    return [(tool, 1.0), (zero, 1.0), (own, 1.0)]


def rows(design: ExperimentDesign, rng: np.random.Generator) -> Imperfection:
    """Steps and a shake far below the noise."""
    step = rng.uniform(0.0, 0.4) * design.noise_std
    drawn = EFFECTS["base.vibration"].draw(design, rng, rng.uniform(0.02, 0.2)).rows
    assert drawn is not None and drawn.shake is not None
    rise = float(np.max(np.mean((drawn.shake / design.noise_std) ** 2, axis=0)))
    calm = min(1.0, float(np.sqrt(MOST_RISE / max(rise, 1e-12)))) * drawn.shake
    return Imperfection(
        "background", {}, rows=RowImperfection(np.ones(6), step, calm, drawn.frequency)
    )


def background(world: ImperfectRobot, rng: np.random.Generator) -> list[Scaled]:
    """Most families a little wrong at once, within a random total gap; nuisances apart."""
    design = world.design
    target = float(
        np.exp(rng.uniform(np.log(SMALLEST_IMPERFECTION), np.log(0.9 * LARGEST_IMPERFECTION)))
    )
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
        if SMALLEST_IMPERFECTION <= found <= min(1.3 * target, LARGEST_IMPERFECTION):
            break
        scale *= float(np.clip(np.sqrt(0.95 * target / max(found, 1e-12)), 1e-3, 1e3))
    return [*around, *[(item, scale) for item in drawn], (rows(design, rng), 1.0)]
