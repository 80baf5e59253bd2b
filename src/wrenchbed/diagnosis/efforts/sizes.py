"""Sizes of causes with standard uncertainty: numbers of amplitudes, and friction as a curve.

Uncertainty is the scatter of fits without each block of time (jackknife over blocks, Künsch 1989,
doi 10.1214/aos/1176347265), which grows with noise that remembers and with a law that is not right,
and what ordinary errors of all stated values move a fit by: the same in every block of time.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchbed.diagnosis.efforts.arm_columns import LIGHT
from wrenchbed.diagnosis.efforts.columns import Block
from wrenchbed.diagnosis.efforts.dictionary import BLOCKS, Dictionary
from wrenchbed.diagnosis.efforts.names import EFFECTS
from wrenchbed.diagnosis.efforts.twin_fit import fitted

_WAVES = ("drive.cogging", "drive.ripple", "link.spring")
"""Effects whose size is the amplitude of a wave over the joint's angle."""


@dataclass(frozen=True, eq=False)
class Folds:
    """Amplitudes (B, P) without each block of time, of all rows (P,), and their errors (S, P) where
    one stated value is off by its ordinary spread."""

    each: np.ndarray
    whole: np.ndarray
    errors: np.ndarray

    @classmethod
    def of(cls, d: Dictionary, blocks: tuple[int, ...]) -> "Folds":
        """Amplitudes of the simulator with the causes ``blocks``, without each block of time."""
        each = np.stack([fitted(d, blocks, without=k).x for k in range(BLOCKS)])
        fit = fitted(d, blocks)
        return cls(each, fit.x, fit.errors)

    def number(self, of: Callable[[np.ndarray], float]) -> dict[str, float]:
        """``value`` and ``std`` of a number that is made ``of`` amplitudes (P,)."""
        value = of(self.whole)
        each = np.array([of(x) for x in self.each])
        scatter = (BLOCKS - 1) / BLOCKS * ((each - each.mean()) ** 2).sum()
        stated = sum((of(self.whole + error) - value) ** 2 for error in self.errors)
        return {"value": value, "std": float(np.sqrt(scatter + stated))}


def parameters(d: Dictionary, folds: Folds, block: int) -> dict[str, Any]:
    """``parameters`` of an entry of ``which``: the size, and what else belongs to the cause."""
    b, at = d.blocks[block], d.at[block]
    named = EFFECTS[b.effect]
    unit = named.unit
    if b.joint is not None and (d.joint[at] >= 0).all():
        unit = d.scene.robot.joints[b.joint - 1].own(unit)
    size = folds.number(lambda x: _size(b, _amplitudes(d, b, x, at), d, at))
    result: dict[str, Any] = {named.size: {**size, "unit": unit}}
    result |= _more(b, d, folds, at)
    if b.joint is not None:
        result["joint"] = {"value": b.joint}
    return result


def mass_of_tool(d: Dictionary, x: np.ndarray) -> float:
    """Mass of the tool [kg] at amplitudes (P,): a moment over it is a way of its centre."""
    mass = float(d.scene.model.robot.tool(d.scene.theta).mass)
    return max(mass + float(x[d.names.index("tool.mass")]), LIGHT)


def _amplitudes(d: Dictionary, block: Block, x: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Amplitudes of a cause's columns, those of a tool's centre as its way [m]."""
    return x[at] / mass_of_tool(d, x) if block.effect == "tool.cog" else x[at]


def _size(block: Block, x: np.ndarray, d: Dictionary, at: np.ndarray) -> float:
    names, effect = [d.names[k] for k in at], block.effect
    if block.resists:
        return float(x[np.isin(names, block.resists)].sum())
    if effect in _WAVES:
        amplitudes = x[-2:] if effect == "link.spring" else x[:2]
        return float(np.hypot(*amplitudes))
    if effect in ("drive.delay", "drive.bandwidth"):
        return float(x[0] * block.value)
    if effect in ("link.cog", "link.inertia", "tool.cog", "base.tilt"):
        return float(np.linalg.norm(x))
    if effect in ("link.cable", "drive.asymmetry"):
        which = "cable" if effect == "link.cable" else "asymmetry"
        return float(x[next(k for k, n in enumerate(names) if n.startswith(which))])
    return float(x[0])


def _more(b: Block, d: Dictionary, folds: Folds, at: np.ndarray) -> Mapping[str, Any]:
    effect = b.effect
    if effect in ("drive.cogging", "drive.ripple"):
        assert b.joint is not None
        slides = d.scene.robot.joints[b.joint - 1].unit == "m"
        return {"periods": {"value": b.value / (2.0 * np.pi), "std": None, "unit": "1/m"} if slides
                else {"value": b.value, "std": None, "unit": "1"}}  # fmt: skip
    if effect in ("link.cog", "tool.cog", "link.inertia", "base.tilt"):
        unit = EFFECTS[effect].unit
        return {
            d.names[k].rpartition(".")[2]: folds.number(
                lambda x, i=i: float(_amplitudes(d, b, x, at)[i])
            )
            | {"unit": unit}
            for i, k in enumerate(at)
        }
    return {}
