"""What every robot has: many small imperfections, and stated numbers within their tolerance.

Every effect that the referee can make, under the contract's names.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from wrenchbed.benchmark.referee import arm, sensor, timing, tool
from wrenchbed.benchmark.referee.fault import RefereeFault, RowFault, direction
from wrenchbed.benchmark.referee.machine import Mechanics
from wrenchbed.benchmark.referee.sensor import ZERO
from wrenchbed.benchmark.referee.setting import RefereeSetting
from wrenchbed.benchmark.referee.tool import loaded

STATED = ("sensor.bias", "tool.mass", "tool.cog")
"""Wrong stated numbers: they count on the gap of the robot as stated."""


@dataclass(frozen=True)
class RefereeEffect:
    """How an effect is drawn and compared.

    Attributes:
        draw: of a size in multiples of typical.
        motion: it shows only in motion.
        loops: only robots with closed loops have it.
        between: only the scatter of rows shows it.
        adds: its numbers add up with those of minor imperfections of the same name.
        compared: names (a regular expression) of the numbers that mean the same to the referee and
            to the library.
    """

    draw: Callable[[RefereeSetting, np.random.Generator, float], RefereeFault]
    motion: bool = False
    loops: bool = False
    between: bool = False
    adds: bool = True
    compared: str = ""


_CHANNEL = "[ft][xyz]"

EFFECTS = {
    "sensor.bias": RefereeEffect(sensor.bias, compared=rf"bias\.{_CHANNEL}"),
    "sensor.drift": RefereeEffect(sensor.drift, compared=rf"rate\.{_CHANNEL}"),
    "sensor.gain": RefereeEffect(sensor.gain, compared=rf"gain\.{_CHANNEL}"),
    "sensor.crosstalk": RefereeEffect(sensor.crosstalk, compared=rf"x\.{_CHANNEL}\.{_CHANNEL}"),
    "sensor.hysteresis": RefereeEffect(sensor.hysteresis),
    "sensor.saturation": RefereeEffect(sensor.saturation),
    "sensor.quantization": RefereeEffect(sensor.quantization, between=True),
    "sensor.noise": RefereeEffect(sensor.noise, between=True),
    "sensor.temperature": RefereeEffect(sensor.temperature),
    "sensor.nonlinearity": RefereeEffect(sensor.nonlinearity),
    "sensor.creep": RefereeEffect(sensor.creep),
    "sensor.jump": RefereeEffect(sensor.jump, adds=False, compared=rf"step\.{_CHANNEL}"),
    "mount.rotation": RefereeEffect(arm.mount, compared=r"rotation\.[xyz]"),
    "tool.mass": RefereeEffect(tool.mass, compared="mass"),
    "tool.cog": RefereeEffect(tool.cog, compared=r"cog\.[xyz]"),
    "tool.inertia": RefereeEffect(tool.inertia, motion=True, compared=r"inertia\.[xyz]{2}"),
    "tool.loose": RefereeEffect(tool.loose),
    "tool.flexure": RefereeEffect(tool.flexure),
    "cable.pull": RefereeEffect(tool.hose),
    "cable.torsion": RefereeEffect(tool.torsion),
    "joint.offset": RefereeEffect(arm.offset, compared=r"offset\.q\d"),
    "joint.compliance": RefereeEffect(arm.compliance, compared=r"compliance\.q\d"),
    "joint.backlash": RefereeEffect(arm.backlash, adds=False),
    "joint.gear_error": RefereeEffect(arm.gear_error, adds=False),
    "joint.clearance": RefereeEffect(arm.clearance, loops=True),
    "link.length": RefereeEffect(arm.link_length, loops=True, compared=r"length\.[A-Z]\d\d?[yz]?"),
    "base.tilt": RefereeEffect(arm.tilt, compared="[xy]"),
    "base.compliance": RefereeEffect(arm.base_compliance),
    "base.vibration": RefereeEffect(timing.vibration, between=True),
    "timing.delay": RefereeEffect(timing.delay, motion=True, compared="delay"),
    "timing.lowpass": RefereeEffect(timing.smooth, motion=True, adds=False),
    "timing.stale": RefereeEffect(timing.stale, motion=True, between=True),
    "timing.skew": RefereeEffect(timing.skew, motion=True, compared="skew"),
    "environment.contact": RefereeEffect(tool.pad),
}
"""By name; `tool.self_weight` is exactly a mass and a CoG, so it is only in the background.
The moment of a jump is not compared: any moment between two poses is as true as another."""


def possible(setting: RefereeSetting) -> list[str]:
    """Names of the effects that make sense for a robot and its mode."""
    closed, moving = bool(arm.loops(setting)), setting.mode == "dynamic"
    found = EFFECTS.items()
    return [k for k, e in found if (closed or not e.loops) and (moving or not e.motion)]


_ALWAYS = (
    "sensor.drift", "sensor.gain", "sensor.crosstalk", "sensor.hysteresis", "sensor.temperature",
    "sensor.nonlinearity", "sensor.creep", "mount.rotation", "tool.flexure", "base.tilt",
    "base.compliance", "cable.torsion",
)  # fmt: skip
_CAD = {"m": 2e-4, "rad": 1.5e-4}
"""Scatter of true geometry about the drawing."""
_MASS = 0.06


def background(
    setting: RefereeSetting, rng: np.random.Generator, scale: float
) -> list[RefereeFault]:
    """Small faults of nearly every family; ``scale`` 1 is about a tenth of typical."""

    def small() -> float:
        return scale * 0.1 * float(np.exp(0.5 * rng.standard_normal()))

    faults = [EFFECTS[n].draw(setting, _own(rng), small()) for n in _ALWAYS]
    for j, joint in enumerate(setting.robot.joints):
        faults.append(arm.offset(setting, _own(rng), small(), j))
        if joint.unit == "rad":
            faults.append(arm.compliance(setting, _own(rng), small(), j))
            faults.append(arm.gear_error(setting, _own(rng), small(), j))
    if setting.mode == "dynamic":
        faults.append(timing.delay(setting, _own(rng), small()))
    return [*faults, *_drawing(setting, rng, scale), *_stated(setting, rng), _floor(setting, rng)]


def _own(rng: np.random.Generator) -> np.random.Generator:
    """A stream of its own, so that another scale draws the same faults."""
    return np.random.default_rng(int(rng.integers(2**62)))


def _drawing(setting: RefereeSetting, rng: np.random.Generator, scale: float) -> list[RefereeFault]:
    """Lengths, twists and masses of links are not the drawing's."""
    p = setting.robot.parameters
    skip = set(setting.robot.load) | set(setting.robot.unobservable)
    taken = ("base.", "mount.", "dq", "tool.", "sensor.")
    errors = {
        item.name: float(scale * _CAD[item.unit] * rng.standard_normal())
        for item in p.items
        if item.unit in _CAD and item.name not in skip and not item.name.startswith(taken)
    }
    spec = setting.robot.spec(setting.theta)
    own = {"tool", "sensor_side", "world"}
    mass = {b.name: float(np.exp(_MASS * rng.standard_normal())) for b in spec.bodies}
    mass = {k: v for k, v in mass.items() if k not in own}
    heavier = RefereeFault("background", body=lambda m: replace(m, mass=mass))
    return [arm.geometry(setting, errors), heavier]


def _stated(setting: RefereeSetting, rng: np.random.Generator) -> list[RefereeFault]:
    """Mass, CoG, bias and the sensor's own weight, all within the tolerance of what is stated."""
    dm, dc, db = setting.tolerance
    tool = setting.metadata.tool
    assert tool.mass is not None and tool.cog is not None
    reach = max(float(np.linalg.norm(tool.cog)), 1e-3)
    weight = float(rng.uniform(0.0, 0.3) * min(dm, dc * tool.mass / reach))
    heavier = float(rng.uniform(-0.6, 0.6) * dm)
    off = float(rng.uniform(0.0, 0.6) * dc) * direction(rng)
    zero = rng.uniform(-0.8, 0.8, 6) * db
    names = [f"bias.{c}" for c in ("fx", "fy", "fz", "tx", "ty", "tz")]
    own = setting.robot.parameters.index("sensor.mass")

    def gauge_weight(m: Mechanics) -> Mechanics:
        theta = m.theta.copy()
        theta[own] += weight
        return replace(m, theta=theta)

    return [
        RefereeFault("tool.mass", {"mass": heavier}, body=lambda m: loaded(setting, m, dm=heavier)),
        RefereeFault(
            "tool.cog",
            {f"cog.{a}": float(o) for a, o in zip("xyz", off, strict=True)},
            body=lambda m: loaded(setting, m, dc=off),
        ),
        RefereeFault("tool.self_weight", {"mass": weight}, body=gauge_weight),
        RefereeFault(
            "sensor.bias",
            dict(zip(names, zero.tolist(), strict=True)),
            gauge=lambda ride, y: y + zero,
            stage=ZERO,
        ),
    ]


def _floor(setting: RefereeSetting, rng: np.random.Generator) -> RefereeFault:
    """Counts and a shake far below the noise."""
    step = rng.uniform(0.0, 0.4) * setting.noise
    shake = EFFECTS["base.vibration"].draw(setting, _own(rng), float(rng.uniform(0.02, 0.15))).rows
    assert shake is not None
    return RefereeFault("background", rows=RowFault(step=step, shake=shake.shake))
