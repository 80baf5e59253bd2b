"""True parameters of a look-alike case under the names that a diagnosis publishes.

Only for effects whose numbers mean the same in both physics. What the background of small
imperfections adds to the same number belongs to the truth: the robot has it.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from wrenchbed.benchmark.lookalikes import ExperimentDesign, LookalikeCase
from wrenchbed.benchmark.lookalikes.catalogue import EFFECTS
from wrenchbed.benchmark.lookalikes.loads import RigidLoad
from wrenchbed.benchmark.scoring.rows import Number
from wrenchbed.diagnosis.prepare.configuration import STATED
from wrenchbed.effects.chain import effects
from wrenchbed.physics.wrench import CHANNELS


def truth(design: ExperimentDesign, case: LookalikeCase, effect: str) -> dict[str, float] | None:
    """True parameters of an effect, SI; what is not named is 0. None where forms differ."""
    if effect in STATED:
        return _stated(design, case, effect)
    drawn = EFFECTS.get(effect)
    if drawn is None or drawn.published is None:
        return None
    total: dict[str, float] = {}
    for item, share in case.items:
        if item.name == effect and (share == 1.0 or drawn.adds):
            for name, value in drawn.published(item.values).items():
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
    given = effects()[effect].amplitudes(published) or {}
    found = [
        Number(f"{effect}:{name}", float(p["value"]), float(p["std"]), true.get(name, 0.0))
        for name, p in given.items()
        if p.get("std") is not None and np.isfinite(p["value"])
    ]
    names = EFFECTS[effect].published
    needed = true if names is None else names(case.sizes[effect])
    return tuple(found), set(needed) <= set(given)


def _stated(design: ExperimentDesign, case: LookalikeCase, effect: str) -> dict[str, float]:
    """Errors of a stated number, with what lies within its tolerance."""
    items = [(i, k) for i, k in case.items if i.name in (*STATED, "background")]
    if effect == STATED[0]:
        zero = np.zeros((1, 6))
        shifts = [k * i.sensor(zero)[0] for i, k in items if i.sensor is not None]
        total = np.sum(shifts, axis=0) if shifts else np.zeros(6)
        return {f"bias.{c}": float(v) for c, v in zip(CHANNELS, total, strict=True)}
    load: RigidLoad = design.load
    for item, _ in items:
        if item.tool is not None:
            load = item.tool(load, design.motion)
    if effect == STATED[1]:
        return {"mass": load.mass - design.load.mass}
    shift = load.cog - design.load.cog
    return {f"cog.{a}": float(v) for a, v in zip("xyz", shift, strict=True)}
