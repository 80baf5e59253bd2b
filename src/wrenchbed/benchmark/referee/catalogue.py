"""Every effect and every other fault that the referee can make, and minor imperfections.

Typical sizes and ranges are estimates.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from wrenchbed.benchmark import frame
from wrenchbed.benchmark.frame import Rng, by_channel
from wrenchbed.benchmark.referee import body, fault, outside, sensor
from wrenchbed.benchmark.referee.fault import RefereeFault, RowFault, direction
from wrenchbed.benchmark.referee.scenario import RefereeSetting

Draw = Callable[..., RefereeFault]
"""Draws a fault for a setting with a generator, of a size in multiples of typical."""
DRAWS: dict[str, Draw] = frame.draws(body, sensor)
"""Draws of the library's effects by name."""
FAMILIES: dict[str, Draw] = frame.draws(outside)
"""Faults outside every library, by name; probabilities were learnt on none of them."""
_ALWAYS = (
    "sensor.drift", "sensor.gain", "sensor.crosstalk", "sensor.hysteresis", "sensor.temperature",
    "sensor.nonlinearity", "sensor.creep", "mount.rotation", "tool.flexure", "base.tilt",
    "base.compliance", "cable.torsion",
)  # fmt: skip
"""Names of the effects in every background."""
_CAD = {"m": 2e-4, "rad": 1.5e-4}
"""Scatter of true geometry about the drawing, by unit: an estimate."""
_MASS = 0.06
"""Relative scatter of the links' masses: an estimate."""


def possible(setting: RefereeSetting) -> list[str]:
    """Names of the effects that make sense for a robot and its mode."""
    shown = ["joints", "repeats"]
    shown += ["loops"] if setting.loops else []
    shown += ["motion"] if setting.mode == "dynamic" else []
    return frame.possible(shown + (["warmth"] if setting.temperature is not None else []))


def background(setting: RefereeSetting, rng: Rng, scale: float) -> list[RefereeFault]:
    """Small faults of nearly every family; ``scale`` 1 is about a tenth of typical."""

    def small() -> float:
        return scale * 0.1 * float(np.exp(0.5 * rng.standard_normal()))

    def drawn(name: str, *joint: int) -> RefereeFault:
        return DRAWS[name](setting, _stream(rng), small(), *joint)

    faults = [drawn(name) for name in _ALWAYS]
    for j, joint in enumerate(setting.robot.joints):
        faults.append(drawn("joint.offset", j))
        if joint.unit == "rad":
            faults += [drawn("joint.compliance", j), drawn("joint.gear_error", j)]
    if setting.mode == "dynamic":
        faults.append(drawn("timing.delay"))
    return [
        *faults,
        *_geometry(setting, rng, scale),
        *_within_tolerance(setting, rng),
        _between_rows(setting, rng),
    ]


def _stream(rng: Rng) -> Rng:
    """A separate random stream, so that another scale draws the same faults."""
    return np.random.default_rng(int(rng.integers(2**62)))


def _geometry(setting: RefereeSetting, rng: Rng, scale: float) -> list[RefereeFault]:
    """Lengths, twists and masses of links that differ from the drawing."""
    robot = setting.robot
    skip = {*robot.load, *robot.unobservable, *robot.zero_names}
    taken = ("base.", "mount.", "tool.", "sensor.")
    errors = {
        item.name: float(scale * _CAD[item.unit] * rng.standard_normal())
        for item in robot.parameters.items
        if item.unit in _CAD and item.name not in skip and not item.name.startswith(taken)
    }
    spec = setting.robot.spec(setting.theta)
    others = {"tool", "sensor_side", "world"}
    mass = {b.name: float(np.exp(_MASS * rng.standard_normal())) for b in spec.bodies}
    mass = {k: v for k, v in mass.items() if k not in others}
    masses = RefereeFault(name="background", body=lambda m: replace(m, mass=mass))
    return [replace(fault.not_as_drawn(setting, errors), name="link.length"), masses]


def _within_tolerance(setting: RefereeSetting, rng: Rng) -> list[RefereeFault]:
    """Mass, CoG, bias and the sensor's own weight, all within the tolerance of what is stated."""
    dm, dc, db = setting.tolerance
    reach = max(float(np.linalg.norm(setting.cog)), 1e-3)
    weight = float(rng.uniform(0.0, 0.3) * min(dm, dc * setting.mass / reach))
    more = float(rng.uniform(-0.6, 0.6) * dm)
    error = float(rng.uniform(0.0, 0.6) * dc) * direction(rng)
    zero = rng.uniform(-0.8, 0.8, 6) * db
    faults = {
        "tool.mass": fault.heavier(setting, more),
        "tool.cog": fault.off(setting, error),
        "tool.self_weight": fault.misshapen(setting, {"mass": weight}, {"sensor.mass": weight}),
        "sensor.bias": fault.shifted(by_channel(zero, "bias."), zero),
    }
    return [replace(made, name=name) for name, made in faults.items()]


def _between_rows(setting: RefereeSetting, rng: Rng) -> RefereeFault:
    """Quantization and vibration far below the noise."""
    step = rng.uniform(0.0, 0.4) * setting.noise
    shake = body.base_vibration(setting, _stream(rng), float(rng.uniform(0.02, 0.15))).rows
    assert shake is not None
    return RefereeFault(name="background", rows=RowFault(step=step, shake=shake.shake))
