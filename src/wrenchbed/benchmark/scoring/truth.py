"""True parameters of a look-alike case under the names that a diagnosis publishes.

Only for effects whose numbers mean the same in both physics. What the background of small
imperfections adds to the same number belongs to the truth: the robot has it.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from wrenchbed.benchmark.lookalikes import ExperimentDesign, LookalikeCase
from wrenchbed.benchmark.lookalikes.loads import RigidLoad
from wrenchbed.benchmark.scoring.rows import Number
from wrenchbed.diagnosis.evidence.dictionary import STATED
from wrenchbed.physics.wrench import CHANNELS

Values = Mapping[str, float]


def truth(design: ExperimentDesign, case: LookalikeCase, effect: str) -> dict[str, float] | None:
    """True parameters of an effect, SI; what is not named is 0. None where forms differ."""
    if effect in STATED:
        return _stated(design, case, effect)
    if effect not in _NAMES:
        return None
    total: dict[str, float] = {}
    for item, share in case.items:
        if item.name == effect and (share == 1.0 or effect not in _OWN_ONLY):
            for name, value in _NAMES[effect](item.values).items():
                total[name] = total.get(name, 0.0) + share * value
    return total


def numbers(
    design: ExperimentDesign,
    case: LookalikeCase,
    effect: str,
    published: Mapping[str, Mapping[str, Any]],
) -> tuple[tuple[Number, ...], bool]:
    """Published parameters beside the true ones, and whether they hold all of the cause's."""
    true = truth(design, case, effect)
    if true is None:
        return (), False
    told = as_published(effect, published)
    found = [
        Number(f"{effect}:{name}", float(p["value"]), float(p["std"]), true.get(name, 0.0))
        for name, p in told.items()
        if p.get("std") is not None and np.isfinite(p["value"])
    ]
    own = case.sizes[effect]
    needed = true if effect in STATED else _NAMES[effect](own)
    return tuple(found), set(needed) <= set(told)


def _stated(design: ExperimentDesign, case: LookalikeCase, effect: str) -> dict[str, float]:
    """Errors of a stated number, with what lies within its tolerance."""
    items = [(i, k) for i, k in case.items if i.name in (*STATED, "background")]
    if effect == "sensor.bias":
        zero = np.zeros((1, 6))
        shifts = [k * i.sensor(zero)[0] for i, k in items if i.sensor is not None]
        total = np.sum(shifts, axis=0) if shifts else np.zeros(6)
        return {f"bias.{c}": float(v) for c, v in zip(CHANNELS, total, strict=True)}
    load: RigidLoad = design.load
    for item, _ in items:
        if item.tool is not None:
            load = item.tool(load, design.motion)
    if effect == "tool.mass":
        return {"mass": load.mass - design.load.mass}
    shift = load.cog - design.load.cog
    return {f"cog.{a}": float(v) for a, v in zip("xyz", shift, strict=True)}


def as_published(
    effect: str, published: Mapping[str, Mapping[str, Any]]
) -> dict[str, Mapping[str, Any]]:
    """Published numbers under the names of true ones: a joint's stiffness as 1/k ± σ/k²."""
    if effect != "joint.compliance" or "stiffness" not in published:
        return dict(published)
    k, std = published["stiffness"]["value"], published["stiffness"]["std"]
    give = {"value": 1.0 / k, "std": None if std is None else std / k**2}
    return {f"compliance.q{published['joint']['value']}": give}


def _prefixed(stem: str) -> Callable[[Values], dict[str, float]]:
    return lambda v: {f"{stem}.{k}": x for k, x in v.items() if k in CHANNELS}


def _axes(stem: str) -> Callable[[Values], dict[str, float]]:
    return lambda v: {f"{stem}{k}": x for k, x in v.items()}


def _of_joints(
    amplitude: str, value: str, turn: Callable[[float], float]
) -> Callable[[Values], dict[str, float]]:
    def told(v: Values) -> dict[str, float]:
        ends = [k.removeprefix("joint") for k in v if k.startswith("joint")]
        return {f"{amplitude}.q{int(v['joint' + e])}": turn(v[value + e]) for e in ends}

    return told


def _skew(v: Values) -> dict[str, float]:
    # there the sensor's clock is ahead, here its readings are late
    return {"skew": -v["rate"]} if "rate" in v else {"channel": v["channel"]}


_OWN_ONLY = ("sensor.jump", "joint.compliance")
"""Jumps at other moments, and stiffness at other loads, do not add to the cause's own."""
_NAMES: dict[str, Callable[[Values], dict[str, float]]] = {
    "tool.inertia": _axes("inertia."),
    "base.tilt": _axes(""),
    "mount.rotation": _axes("rotation."),
    "joint.offset": _of_joints("offset", "offset", float),
    "joint.compliance": _of_joints("compliance", "stiffness", lambda k: 1.0 / k),
    "sensor.gain": _prefixed("gain"),
    "sensor.drift": _prefixed("rate"),
    "sensor.jump": lambda v: {"time": v["time"]} | _prefixed("step")(v),
    "sensor.crosstalk": lambda v: {"x." + k.replace("_", "."): x for k, x in v.items()},
    "link.length": _axes("length."),
    "timing.delay": _axes(""),
    "timing.skew": _skew,
}
"""How the generator's numbers are called here."""
