"""Sizes of causes with standard uncertainty."""

from functools import partial
from typing import Any

import numpy as np

from wrenchbed.diagnosis.efforts.arm_columns import LIGHT
from wrenchbed.diagnosis.efforts.dictionary import Dictionary
from wrenchbed.diagnosis.efforts.names import known
from wrenchbed.diagnosis.efforts.simulator import Simulator
from wrenchbed.effects.drives.lag import Lag
from wrenchbed.effects.drives.wave import Wave


def parameters(fit: Simulator, block: int) -> dict[str, Any]:
    """``parameters`` of an entry of ``which``: the size, and what else belongs to the cause."""
    d, b = fit.d, fit.d.blocks[block]
    size = known()[b.effect].size
    result: dict[str, Any] = {
        size.name: {**fit.number(partial(_size, d, block)), "unit": unit_of(d, block)}
    }
    if b.joint is not None and isinstance(known()[b.effect], Wave):
        slides = d.scene.robot.joints[b.joint - 1].unit == "m"
        result["periods"] = (
            {"value": b.value / (2.0 * np.pi), "std": None, "unit": "1/m"} if slides
            else {"value": b.value, "std": None, "unit": "1"}
        )  # fmt: skip
    elif size.vector and not size.columns:
        for i, k in enumerate(sized(d, block)):
            number = fit.number(partial(_amplitude, d, block, i))
            result[d.names[k].rpartition(".")[2]] = {**number, "unit": size.unit}
    if b.joint is not None:
        result["joint"] = {"value": b.joint}
    return result


def _amplitude(d: Dictionary, block: int, i: int, x: np.ndarray) -> float:
    return float(_amplitudes(d, block, x)[i])


def unit_of(d: Dictionary, block: int) -> str:
    """Unit of a cause's size, that of a slide where its joint is one."""
    b = d.blocks[block]
    unit = known()[b.effect].size.unit
    if b.joint is None or not (d.joint[d.at[block]] >= 0).all():
        return unit
    return d.scene.robot.joints[b.joint - 1].own(unit)


def sized(d: Dictionary, block: int) -> list[int]:
    """Indices of the columns whose amplitudes make a cause's size."""
    begins = known()[d.blocks[block].effect].size.columns or ("",)
    return [int(k) for k in d.at[block] if d.names[k].startswith(begins)]


def scale(d: Dictionary, block: int, x: np.ndarray) -> float:
    """Size of a cause over the amplitudes of its columns, at amplitudes x (P,) of all."""
    effect = d.blocks[block].effect
    if effect == "tool.cog":  # moments
        return 1.0 / mass_of_tool(d, x)
    return d.blocks[block].value if isinstance(known()[effect], Lag) else 1.0


def mass_of_tool(d: Dictionary, x: np.ndarray) -> float:
    """Mass of the tool [kg] at amplitudes (P,)."""
    mass = float(d.scene.model.robot.tool(d.scene.theta).mass)
    return max(mass + float(x[d.names.index("tool.mass")]), LIGHT)


def _amplitudes(d: Dictionary, block: int, x: np.ndarray) -> np.ndarray:
    return scale(d, block, x) * x[sized(d, block)]


def _size(d: Dictionary, block: int, x: np.ndarray) -> float:
    parts = _amplitudes(d, block, x)
    return float(
        np.linalg.norm(parts) if known()[d.blocks[block].effect].size.vector else parts.sum()
    )
