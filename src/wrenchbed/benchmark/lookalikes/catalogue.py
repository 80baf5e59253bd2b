"""The effects that a design can show, and what every case has a little of.

Typical sizes and ranges are estimates.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np

from wrenchbed.benchmark import frame
from wrenchbed.benchmark.frame import STATED, Rng, between, log_uniform, possible
from wrenchbed.benchmark.lookalikes import arm, imperfection, outside, sensor, tool
from wrenchbed.benchmark.lookalikes.design import ExperimentDesign
from wrenchbed.benchmark.lookalikes.imperfection import Imperfection, ImperfectRobot, Scaled

Draw = Callable[..., Imperfection]
"""Draws an imperfection for a design with a generator; an effect's also of a size in multiples of
typical."""
DRAWS: dict[str, Draw] = frame.draws(arm, sensor, tool)
"""Draws of the library's effects by name."""
FAMILIES: dict[str, Draw] = frame.draws(outside, mark="_")
"""Draws of families outside every library, by name."""
_BY_JOINTS = ("gas_spring", "magnet")
"""Families that only robots with joints have."""
LARGEST = 8.0
"""Largest size of a cause in multiples of typical."""
_PROBES = 4
"""Draws that find out whether a design shows an effect."""
_PROBED_GAP = 1.3
"""Gap that one of the `_PROBES` draws must reach: an estimate."""
SMALLEST_BACKGROUND, LARGEST_BACKGROUND = 0.02, 0.45
"""Range of the gap that all small imperfections make together."""
MOST_RISE = 0.25
"""Rise of a channel's row variance by the background's vibration, at most."""
_HARD = (
    "tool.inertia", "tool.loose", "tool.flexure", "joint.compliance", "joint.backlash",
    "joint.gear_error", "joint.clearance", "base.compliance", "sensor.creep",
)  # fmt: skip
"""Effects that often show too little: whether they can is tried out once for each design."""
LEAST_REPEATS = 4
"""Rows of a hold from which the scatter of rows shows: an estimate."""
_LEAST_RISE = 0.5
"""Range of a recorded temperature [K] below which it shows nothing: an estimate."""
_NOT_IN_BACKGROUND = (*STATED, "sensor.saturation", "environment.contact", "timing.stale")
_PRESENT = 0.7
"""Probability of each effect to be in the background."""
_TRIES = 6
"""Largest number of scalings of a background."""


@lru_cache(maxsize=8)
def effects(design: ExperimentDesign) -> tuple[str, ...]:
    """Names of the effects that can be drawn for a design: those that can show in it."""
    return tuple(n for n in _fitting(design) if n not in _HARD or _shows(design, n))


def _fitting(design: ExperimentDesign) -> list[str]:
    """Names of the effects whose needs a design meets."""
    warm = design.temperature
    met = {
        "motion": design.moving,
        "joints": bool(design.robot.joints),
        "loops": bool(design.distal_links),
        "warmth": warm is not None and np.ptp(warm) > _LEAST_RISE,
        "repeats": design.moving or design.samples >= LEAST_REPEATS,
    }
    return possible(need for need, is_met in met.items() if is_met)


def _shows(design: ExperimentDesign, effect: str) -> bool:
    """Whether one of a few large draws reaches a gap that counts."""
    robot = ImperfectRobot(design)
    for probe in range(_PROBES):
        item = DRAWS[effect](design, np.random.default_rng([probe, 7]), 0.8 * LARGEST)
        with np.errstate(invalid="ignore"):
            difference = robot.reading([(item, 1.0)]) - design.nominal
        if np.isfinite(difference).all() and design.usual.gap(difference) > _PROBED_GAP:
            return True
    return False


def background(robot: ImperfectRobot, rng: Rng) -> list[Scaled]:
    """Background of a robot: most effects at once, small, within a random total gap; and stated
    numbers wrong within tolerance."""
    design = robot.design
    target = log_uniform(rng, SMALLEST_BACKGROUND, 0.9 * LARGEST_BACKGROUND)
    around = _within_tolerance(design, rng)
    drawn = []
    for effect in _fitting(design):
        if between(effect) or effect in _NOT_IN_BACKGROUND or rng.uniform() > _PRESENT:
            continue
        size = 0.1 * float(np.exp(0.7 * rng.standard_normal()))
        seed = int(rng.integers(2**62))
        drawn.append(DRAWS[effect](design, np.random.default_rng(seed), size))
    scale = 0.5
    for _ in range(_TRIES):
        reading = robot.reading([(item, scale) for item in drawn])
        reached = design.usual.gap(reading - design.nominal)
        if SMALLEST_BACKGROUND <= reached <= min(1.3 * target, LARGEST_BACKGROUND):
            break
        scale *= float(np.clip(np.sqrt(0.95 * target / max(reached, 1e-12)), 1e-3, 1e3))
    return [*around, *[(item, scale) for item in drawn], (_between_rows(design, rng), 1.0)]


def _within_tolerance(design: ExperimentDesign, rng: Rng) -> list[Scaled]:
    """Errors of bias, mass and CoG within their tolerance, and an unstated sensor weight."""
    mass, cog, bias = design.tolerance
    shift = rng.uniform(-0.9, 0.9, 6) * bias
    more = float(rng.uniform(-0.9, 0.9) * mass)
    direction = rng.standard_normal(3)
    error = rng.uniform(0.0, 0.9) * cog * direction / np.linalg.norm(direction)
    weight = 0.04 * min(0.1, 0.4 * mass / 0.04) * imperfection.spread(rng)
    weighing = Imperfection(
        {"mass": weight}, tool=lambda load, _: replace(load, sensor_mass=load.sensor_mass + weight)
    )
    faults = {
        "tool.mass": imperfection.heavier(more),
        "tool.cog": imperfection.off(error),
        "sensor.bias": imperfection.biased(shift),
        "tool.self_weight": weighing,
    }
    return [(replace(fault, name=name), 1.0) for name, fault in faults.items()]


def _between_rows(design: ExperimentDesign, rng: Rng) -> Imperfection:
    """Quantization and vibration far below the noise."""
    step = rng.uniform(0.0, 0.4) * design.noise_std
    drawn = arm.base_vibration(design, rng, rng.uniform(0.02, 0.2)).rows
    assert drawn is not None and drawn.shake is not None
    wrench, frequency = drawn.shake
    rise = float(np.max(np.mean((wrench / design.noise_std) ** 2, axis=0)))
    wrench = min(1.0, float(np.sqrt(MOST_RISE / max(rise, 1e-12)))) * wrench
    rows = imperfection.RowImperfection(step=step, shake=imperfection.Shaking(wrench, frequency))
    return Imperfection(name="background", rows=rows)


def families(design: ExperimentDesign) -> tuple[str, ...]:
    """Names of the families outside every library that a design can show."""
    return tuple(n for n in FAMILIES if design.robot.joints or n not in _BY_JOINTS)
