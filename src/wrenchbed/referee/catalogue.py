"""Every effect that the referee can make, under the contract's names."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wrenchbed.referee import arm, carried, clocks, floor, gauges
from wrenchbed.referee.fault import Fault
from wrenchbed.referee.setting import Setting

STATED = ("sensor.bias", "tool.mass", "tool.cog")
"""Wrong stated numbers: they count on the gap of the robot as stated."""


@dataclass(frozen=True)
class Effect:
    """How an effect is drawn, when it can be, and whether only the scatter of rows shows it."""

    draw: Callable[[Setting, np.random.Generator, float], Fault]
    motion: bool = False
    loops: bool = False
    between: bool = False


EFFECTS = {
    "sensor.bias": Effect(gauges.bias),
    "sensor.drift": Effect(gauges.drift),
    "sensor.gain": Effect(gauges.gain),
    "sensor.crosstalk": Effect(gauges.crosstalk),
    "sensor.hysteresis": Effect(gauges.hysteresis),
    "sensor.saturation": Effect(gauges.saturation),
    "sensor.quantization": Effect(gauges.quantization, between=True),
    "sensor.noise": Effect(gauges.noise, between=True),
    "sensor.temperature": Effect(gauges.temperature),
    "sensor.nonlinearity": Effect(gauges.nonlinearity),
    "sensor.creep": Effect(gauges.creep),
    "sensor.jump": Effect(gauges.jump),
    "mount.rotation": Effect(arm.mount),
    "tool.mass": Effect(carried.mass),
    "tool.cog": Effect(carried.cog),
    "tool.inertia": Effect(carried.inertia, motion=True),
    "tool.loose": Effect(carried.loose),
    "tool.flexure": Effect(carried.flexure),
    "cable.pull": Effect(carried.hose),
    "cable.torsion": Effect(carried.torsion),
    "joint.offset": Effect(arm.offset),
    "joint.compliance": Effect(arm.compliance),
    "joint.backlash": Effect(arm.backlash),
    "joint.gear_error": Effect(arm.gear_error),
    "joint.clearance": Effect(arm.clearance, loops=True),
    "link.length": Effect(arm.link_length, loops=True),
    "base.tilt": Effect(arm.tilt),
    "base.compliance": Effect(arm.base_compliance),
    "base.vibration": Effect(floor.vibration, between=True),
    "timing.delay": Effect(clocks.delay, motion=True),
    "timing.lowpass": Effect(clocks.smooth, motion=True),
    "timing.stale": Effect(clocks.stale, motion=True, between=True),
    "timing.skew": Effect(clocks.skew, motion=True),
    "environment.contact": Effect(carried.pad),
}
"""By name; `tool.self_weight` is exactly a mass and a CoG, so it is only in the background."""


def possible(setting: Setting) -> list[str]:
    """Names of the effects that make sense for a robot and its mode."""
    closed, moving = bool(arm.loops(setting)), setting.mode == "dynamic"
    found = EFFECTS.items()
    return [k for k, e in found if (closed or not e.loops) and (moving or not e.motion)]
