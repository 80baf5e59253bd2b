"""The effects that a design can show, faults of no library, and what every case has a little of.

A diagnosis must call a fault outside the library unknown. Typical sizes and ranges are estimates.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from wrenchbed.benchmark.frame import STATED, Rng, between, log_uniform, possible, register
from wrenchbed.benchmark.lookalikes import arm, imperfection, sensor, tool
from wrenchbed.benchmark.lookalikes.design import ExperimentDesign
from wrenchbed.benchmark.lookalikes.imperfection import Imperfection, ImperfectRobot, Scaled
from wrenchbed.benchmark.lookalikes.loads import rotate_back, wrench_at

Family = Callable[[ExperimentDesign, Rng], Imperfection]
FAMILIES: dict[str, Family] = {}
"""Families outside every library, by name."""
_BY_JOINTS = ("gas_spring", "magnet")
"""Families that only robots with joints have."""
_G = 9.81
"""Gravity by which typical accelerations are scaled [m/s²]."""
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


def effects(design: ExperimentDesign) -> tuple[str, ...]:
    """Names of the effects that can be drawn for a design: those that can show in it."""

    def shown() -> tuple[str, ...]:
        return tuple(n for n in _fitting(design) if n not in _HARD or _shows(design, n))

    return design.once("effects", shown)


def _fitting(design: ExperimentDesign) -> list[str]:
    """Names of the effects whose needs a design meets."""
    warm = design.temperature
    met = {
        "motion": design.moving,
        "joints": design.has_joints,
        "loops": bool(arm.distal_links(design)),
        "warmth": warm is not None and np.ptp(warm) > _LEAST_RISE,
        "repeats": design.moving or design.samples >= LEAST_REPEATS,
    }
    return possible(need for need, is_met in met.items() if is_met)


def _shows(design: ExperimentDesign, effect: str) -> bool:
    """Whether one of a few large draws reaches a gap that counts."""
    robot = ImperfectRobot(design)
    for probe in range(_PROBES):
        item = imperfection.DRAWS[effect](design, np.random.default_rng([probe, 7]), 0.8 * LARGEST)
        with np.errstate(invalid="ignore"):
            difference = robot.reading([(item, 1.0)]) - design.nominal
        if np.isfinite(difference).all() and design.gap(difference) > _PROBED_GAP:
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
        drawn.append(imperfection.DRAWS[effect](design, np.random.default_rng(seed), size))
    scale = 0.5
    for _ in range(_TRIES):
        reading = robot.reading([(item, scale) for item in drawn])
        reached = design.gap(reading - design.nominal)
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
    weight = tool.self_weight(design, rng, min(0.1, 0.4 * mass / 0.04))
    return [
        (replace(tool.heavier(heavier), name="tool.mass"), 1.0),
        (replace(tool.off(off), name="tool.cog"), 1.0),
        (replace(sensor.biased(shift), name="sensor.bias"), 1.0),
        (weight, 1.0),
    ]


def _between_rows(design: ExperimentDesign, rng: Rng) -> Imperfection:
    """Quantization and vibration far below the noise."""
    step = rng.uniform(0.0, 0.4) * design.noise_std
    drawn = arm.vibration(design, rng, rng.uniform(0.02, 0.2)).rows
    assert drawn is not None and drawn.shake is not None
    wrench, frequency = drawn.shake
    rise = float(np.max(np.mean((wrench / design.noise_std) ** 2, axis=0)))
    wrench = min(1.0, float(np.sqrt(MOST_RISE / max(rise, 1e-12)))) * wrench
    rows = imperfection.RowImperfection(step=step, shake=imperfection.Shaking(wrench, frequency))
    return Imperfection(name="background", rows=rows)


def families(design: ExperimentDesign) -> tuple[str, ...]:
    """Names of the families outside every library that a design can show."""
    return tuple(n for n in FAMILIES if design.has_joints or n not in _BY_JOINTS)


def _zero(shift: np.ndarray) -> Imperfection:
    """Imperfection that shifts the sensor's zero by (N, 6) [N, N·m]."""
    return Imperfection(sensor=lambda y: y + shift)


def _cog(shift: np.ndarray) -> Imperfection:
    """Imperfection that shifts the centre of gravity by (N, 3) [m]."""
    return Imperfection(tool=lambda load, _: replace(load, cog=load.cog + shift))


def _some_channels(design: ExperimentDesign, rng: Rng) -> np.ndarray:
    return 5.0 * design.noise_std * sensor.channels(rng, one=0.4)


@register(FAMILIES, "seating")
def seating(design: ExperimentDesign, rng: Rng) -> Imperfection:
    """Something settles anew at each pose: offsets with heavy tails."""
    count = len(design)
    which = np.arange(count)
    if design.moving:
        change = np.cumsum(rng.exponential(2.5, count))
        which = np.searchsorted(change, design.t - design.t[0])
    offsets = np.clip(rng.standard_t(2.2, (int(which.max()) + 1, 6)), -8.0, 8.0)
    return _zero(offsets[which] * _some_channels(design, rng))


@register(FAMILIES, "gas_spring")
def gas_spring(design: ExperimentDesign, rng: Rng) -> Imperfection:
    """A hinge or a dress pack pushes in proportion to the angle of joint 2."""
    j = min(1, design.q.shape[1] - 1)
    angle = design.q[:, j] - design.q[:, j].mean()
    axis = rng.standard_normal(3)
    push = 0.5 * angle[:, None] * axis
    wrench = wrench_at(rng.normal(0.0, 0.05, 3), push)
    return Imperfection(load=lambda motion, load: wrench)


@register(FAMILIES, "magnet")
def magnet(design: ExperimentDesign, rng: Rng) -> Imperfection:
    """A magnet near one spot of the workspace, or near one angle of joint 4, pulls."""
    if design.has_joints and rng.uniform() < 0.4 and design.q.shape[1] > 3:
        angle = design.q[:, 3]
        away = ((angle - rng.choice(angle)) / max(0.35 * float(np.std(angle)), 1e-3)) ** 2
    else:
        place = design.motion.position
        centre = place[rng.integers(len(place))] + rng.normal(0.0, 0.02, 3)
        wide = max(0.6 * float(np.linalg.norm(place.std(axis=0))), 1e-3)
        away = ((place - centre) ** 2).sum(axis=1) / wide**2
    pull = np.exp(-0.5 * away)[:, None] * rng.standard_normal(3)
    lever = rng.normal(0.0, 0.05, 3)
    return Imperfection(
        load=lambda motion, load: wrench_at(lever, rotate_back(motion.rotation, pull))
    )


@register(FAMILIES, "product")
def product(design: ExperimentDesign, rng: Rng) -> Imperfection:
    """Two channels multiply into a force; into a torque it would be a flexing tool."""
    into = int(rng.integers(3))
    a, b = (int(k) for k in rng.choice(np.delete(np.arange(6), into), 2, replace=False))
    factor = 6.0 * design.noise_std[into] / (design.swing[a] * design.swing[b])
    channel = np.eye(6)[into]
    return Imperfection(sensor=lambda y: y + np.outer(factor * y[:, a] * y[:, b], channel))


@register(FAMILIES, "compressor")
def compressor(design: ExperimentDesign, rng: Rng) -> Imperfection:
    """The zero shifts whenever a compressor runs: a square wave in time."""
    period = float(np.ptp(design.t)) / rng.uniform(3.0, 9.0)
    phase = ((design.t - design.t[0]) / period + rng.uniform()) % 1.0
    on = phase < rng.uniform(0.3, 0.6)
    return _zero(on[:, None] * _some_channels(design, rng))


@register(FAMILIES, "bursts")
def bursts(design: ExperimentDesign, rng: Rng) -> Imperfection:
    """Again and again, for a moment, the reading is far off."""
    count, n = int(rng.integers(5, 10)), len(design)
    shift = np.zeros((n, 6))
    for _ in range(count):
        first = int(rng.integers(n))
        length = int(rng.integers(1, max(2, n // 25)))
        shift[first : first + length] = rng.standard_t(3.0, 6)
    return _zero(3.0 * shift * _some_channels(design, rng))


@register(FAMILIES, "third_harmonic")
def third_harmonic(design: ExperimentDesign, rng: Rng) -> Imperfection:
    """A zero that varies three times per turn of the wrist."""
    if design.has_joints:
        angle = design.q[:, -1]
    else:
        specific = design.motion.specific_force
        angle = np.arctan2(specific[:, 1], specific[:, 0])
    phase = rng.uniform(0.0, 2.0 * np.pi, 6)
    wave = np.sin(3.0 * angle[:, None] + phase)
    return _zero(wave * _some_channels(design, rng))


@register(FAMILIES, "rectified")
def rectified(design: ExperimentDesign, rng: Rng) -> Imperfection:
    """A channel reads the size of another, whatever its sign: a plate that lifts off both ways."""
    to, of = rng.permutation(6)[:2]
    gain = 0.3 * rng.choice([-1.0, 1.0]) * design.full_scale[to] / design.full_scale[of]

    def read(y: np.ndarray) -> np.ndarray:
        result = y.copy()
        result[:, to] += gain * np.abs(y[:, of])
        return result

    return Imperfection(sensor=read)


@register(FAMILIES, "sunbeam")
def sunbeam(design: ExperimentDesign, rng: Rng) -> Imperfection:
    """The zero shifts while the sensor faces a window."""
    down = design.motion.specific_force
    down = down / np.linalg.norm(down, axis=1, keepdims=True)
    facing = down @ down[rng.integers(len(down))]
    return _zero(np.exp(6.0 * (facing - 1.0))[:, None] * 2.0 * _some_channels(design, rng))


@register(FAMILIES, "slow_liquid")
def slow_liquid(design: ExperimentDesign, rng: Rng) -> Imperfection:
    """A thick liquid follows gravity with a lag of several poses."""
    path = design.path
    lag = max(float(np.ptp(path.t)), 1e-9) * rng.uniform(0.02, 0.1)
    level = imperfection.relax(path.t, path.specific_force, lag)[path.at] / _G
    shift = 4e-3 * (level**2 - level.mean(axis=0) ** 2) * rng.standard_normal(3)
    return _cog(shift)
