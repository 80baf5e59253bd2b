"""Every effect that the referee can make, and the minor imperfections that every robot has.

Typical sizes and ranges are estimates.
"""

from dataclasses import replace

import numpy as np

from wrenchbed.benchmark.referee import arm, sensor, tool
from wrenchbed.benchmark.referee import sensor as timing
from wrenchbed.benchmark.referee.fault import (
    DRAWN,
    RefereeFault,
    Rng,
    RowFault,
    by_channel,
    direction,
)
from wrenchbed.benchmark.referee.scenario import RefereeSetting
from wrenchbed.benchmark.referee.true_robot import Mechanics

FILES = (arm, sensor, timing, tool)
"""Modules whose draws are registered by importing them."""
_SUBSYSTEMS = (
    "sensor", "mount", "tool", "cable", "joint", "link", "base", "timing", "environment",
)  # fmt: skip
"""Order in which effects are drawn: cases follow from it and the seed."""
EFFECTS = dict(sorted(DRAWN.items(), key=lambda e: _SUBSYSTEMS.index(e[0].partition(".")[0])))
"""By name; `tool.self_weight` is exactly a mass and a CoG, so it is only in the background."""
STATED = ("sensor.bias", "tool.mass", "tool.cog")
"""Wrong stated numbers: they count on the gap of the robot as stated."""
_ALWAYS = (
    "sensor.drift", "sensor.gain", "sensor.crosstalk", "sensor.hysteresis", "sensor.temperature",
    "sensor.nonlinearity", "sensor.creep", "mount.rotation", "tool.flexure", "base.tilt",
    "base.compliance", "cable.torsion",
)  # fmt: skip
"""Effects of every background."""
_CAD = {"m": 2e-4, "rad": 1.5e-4}
"""Scatter of true geometry about the drawing, by unit: an estimate."""
_MASS = 0.06
"""Relative scatter of the links' masses: an estimate."""


def possible(setting: RefereeSetting) -> list[str]:
    """Names of the effects that make sense for a robot and its mode."""
    closed, moving = bool(arm.loops(setting)), setting.mode == "dynamic"
    warm = setting.temperature is not None
    return [
        k
        for k, e in EFFECTS.items()
        if (closed or not e.loops) and (moving or not e.motion) and (warm or not e.warm)
    ]


def background(setting: RefereeSetting, rng: Rng, scale: float) -> list[RefereeFault]:
    """Small faults of nearly every family; ``scale`` 1 is about a tenth of typical."""

    def small() -> float:
        return scale * 0.1 * float(np.exp(0.5 * rng.standard_normal()))

    faults = [EFFECTS[n].draw(setting, _stream(rng), small()) for n in _ALWAYS]
    for j, joint in enumerate(setting.robot.joints):
        faults.append(arm.offset(setting, _stream(rng), small(), j))
        if joint.unit == "rad":
            faults.append(arm.compliance(setting, _stream(rng), small(), j))
            faults.append(arm.gear_error(setting, _stream(rng), small(), j))
    if setting.mode == "dynamic":
        faults.append(timing.delay(setting, _stream(rng), small()))
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
    p = setting.robot.parameters
    robot = setting.robot
    skip = {*robot.load, *robot.unobservable, *robot.zero_names}
    taken = ("base.", "mount.", "tool.", "sensor.")
    errors = {
        item.name: float(scale * _CAD[item.unit] * rng.standard_normal())
        for item in p.items
        if item.unit in _CAD and item.name not in skip and not item.name.startswith(taken)
    }
    spec = setting.robot.spec(setting.theta)
    others = {"tool", "sensor_side", "world"}
    mass = {b.name: float(np.exp(_MASS * rng.standard_normal())) for b in spec.bodies}
    mass = {k: v for k, v in mass.items() if k not in others}
    heavier = RefereeFault(name="background", body=lambda m: replace(m, mass=mass))
    return [arm.geometry(setting, errors), heavier]


def _within_tolerance(setting: RefereeSetting, rng: Rng) -> list[RefereeFault]:
    """Mass, CoG, bias and the sensor's own weight, all within the tolerance of what is stated."""
    dm, dc, db = setting.tolerance
    stated = setting.metadata.tool
    assert stated.mass is not None and stated.cog is not None
    reach = max(float(np.linalg.norm(stated.cog)), 1e-3)
    weight = float(rng.uniform(0.0, 0.3) * min(dm, dc * stated.mass / reach))
    heavier = float(rng.uniform(-0.6, 0.6) * dm)
    off = float(rng.uniform(0.0, 0.6) * dc) * direction(rng)
    zero = rng.uniform(-0.8, 0.8, 6) * db
    column = setting.robot.parameters.index("sensor.mass")

    def gauge_weight(m: Mechanics) -> Mechanics:
        theta = m.theta.copy()
        theta[column] += weight
        return replace(m, theta=theta)

    shift = {f"cog.{a}": float(o) for a, o in zip("xyz", off, strict=True)}
    return [
        RefereeFault(
            {"mass": heavier}, lambda m: tool.loaded(setting, m, dm=heavier), name="tool.mass"
        ),
        RefereeFault(shift, lambda m: tool.loaded(setting, m, dc=off), name="tool.cog"),
        RefereeFault({"mass": weight}, gauge_weight, name="tool.self_weight"),
        RefereeFault(
            by_channel(zero, "bias"),
            gauge=lambda ride, y: y + zero,
            stage=sensor.ZERO,
            name="sensor.bias",
        ),
    ]


def _between_rows(setting: RefereeSetting, rng: Rng) -> RefereeFault:
    """Quantization and vibration far below the noise."""
    step = rng.uniform(0.0, 0.4) * setting.noise
    shake = arm.vibration(setting, _stream(rng), float(rng.uniform(0.02, 0.15))).rows
    assert shake is not None
    return RefereeFault(name="background", rows=RowFault(step=step, shake=shake.shake))
