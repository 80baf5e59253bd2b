"""What every robot has: many small imperfections, and stated numbers within their tolerance."""

from dataclasses import replace

import numpy as np

from wrenchbed.referee import arm, clocks
from wrenchbed.referee.carried import loaded
from wrenchbed.referee.catalogue import EFFECTS
from wrenchbed.referee.chances import direction
from wrenchbed.referee.fault import Fault, RowFault
from wrenchbed.referee.gauges import ZERO
from wrenchbed.referee.mechanics import Mechanics
from wrenchbed.referee.setting import Setting

_ALWAYS = (
    "sensor.drift", "sensor.gain", "sensor.crosstalk", "sensor.hysteresis", "sensor.temperature",
    "sensor.nonlinearity", "sensor.creep", "mount.rotation", "tool.flexure", "base.tilt",
    "base.compliance", "cable.torsion",
)  # fmt: skip
_CAD = {"m": 2e-4, "rad": 1.5e-4}
"""Scatter of true geometry about the drawing."""
_MASS = 0.06


def background(setting: Setting, rng: np.random.Generator, scale: float) -> list[Fault]:
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
        faults.append(clocks.delay(setting, _own(rng), small()))
    return [*faults, *_drawing(setting, rng, scale), *_stated(setting, rng), _floor(setting, rng)]


def _own(rng: np.random.Generator) -> np.random.Generator:
    """A stream of its own, so that another scale draws the same faults."""
    return np.random.default_rng(int(rng.integers(2**62)))


def _drawing(setting: Setting, rng: np.random.Generator, scale: float) -> list[Fault]:
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
    heavier = Fault("background", body=lambda m: replace(m, mass=mass))
    return [arm.geometry(setting, errors), heavier]


def _stated(setting: Setting, rng: np.random.Generator) -> list[Fault]:
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
        Fault("tool.mass", {"mass": heavier}, body=lambda m: loaded(setting, m, dm=heavier)),
        Fault(
            "tool.cog",
            {f"cog.{a}": float(o) for a, o in zip("xyz", off, strict=True)},
            body=lambda m: loaded(setting, m, dc=off),
        ),
        Fault("tool.self_weight", {"mass": weight}, body=gauge_weight),
        Fault(
            "sensor.bias",
            dict(zip(names, zero.tolist(), strict=True)),
            gauge=lambda ride, y: y + zero,
            stage=ZERO,
        ),
    ]


def _floor(setting: Setting, rng: np.random.Generator) -> Fault:
    """Counts and a shake far below the noise."""
    step = rng.uniform(0.0, 0.4) * setting.noise
    shake = EFFECTS["base.vibration"].draw(setting, _own(rng), float(rng.uniform(0.02, 0.15))).rows
    assert shake is not None
    return Fault("background", rows=RowFault(step=step, shake=shake.shake))
