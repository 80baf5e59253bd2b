"""Sizes of causes with standard uncertainty: numbers of amplitudes, and friction as a curve.

Uncertainty is the scatter of fits without each block of time (jackknife over blocks, Künsch 1989,
doi 10.1214/aos/1176347265): it grows with noise that remembers and with a law that is not right.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchbed.diagnosis.efforts.columns import Block
from wrenchbed.diagnosis.efforts.dictionary import BLOCKS, Dictionary
from wrenchbed.diagnosis.efforts.names import EFFECTS
from wrenchbed.diagnosis.efforts.twin_fit import fitted

_WAVES = ("drive.cogging", "drive.ripple", "link.spring")
"""Effects whose size is the amplitude of a wave over the joint's angle."""


@dataclass(frozen=True, eq=False)
class Folds:
    """Amplitudes (B, P) without each block of time, and of all rows (P,)."""

    each: np.ndarray
    whole: np.ndarray

    @classmethod
    def of(cls, d: Dictionary, blocks: tuple[int, ...]) -> "Folds":
        """Amplitudes of the simulator with the causes ``blocks``, without each block of time."""
        each = np.stack([fitted(d, blocks, without=k).x for k in range(BLOCKS)])
        return cls(each, fitted(d, blocks).x)


def parameters(d: Dictionary, folds: Folds, block: int) -> dict[str, Any]:
    """``parameters`` of an entry of ``which``: the size, and what else belongs to the cause."""
    b, at = d.blocks[block], d.at[block]
    named = EFFECTS[b.effect]
    value = _size(b, folds.whole[at], d, at)
    each = np.array([_size(b, x[at], d, at) for x in folds.each])
    std = jackknife(each)
    unit = named.unit
    if b.joint is not None and (d.joint[at] >= 0).all():
        unit = d.scene.robot.joints[b.joint - 1].own(unit)
    result: dict[str, Any] = {named.size: {"value": value, "std": std, "unit": unit}}
    result |= _more(b, d, folds, at)
    if b.joint is not None:
        result["joint"] = {"value": b.joint}
    return result


def jackknife(each: np.ndarray) -> float:
    """Standard uncertainty of a number from its values without each block of time (B,)."""
    return float(np.sqrt((BLOCKS - 1) / BLOCKS * ((each - each.mean()) ** 2).sum()))


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
        unit, spread = EFFECTS[effect].unit, folds.each[:, at]
        std = np.sqrt((BLOCKS - 1) / BLOCKS * ((spread - spread.mean(axis=0)) ** 2).sum(axis=0))
        return {
            d.names[k].rpartition(".")[2]: {"value": float(x), "std": float(s), "unit": unit}
            for k, x, s in zip(at, folds.whole[at], std, strict=True)
        }
    return {}
