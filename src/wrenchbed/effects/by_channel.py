"""Parameters, variants and curves of effects that have numbers of their own for each channel.

An effect without a formula has many linear amplitudes, smaller by order. A fit's evidence pays for
each that data determine, so a formula that fits is preferred. Numbers of points and weights of such
free forms are estimates.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from wrenchbed.effects.base import Curve, ReadingEffect, Values, Variant
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.model_parameters import Parameter, ParameterSet
from wrenchbed.physics.wrench import CHANNELS, UNITS
from wrenchbed.robots.base import Robot

FREE = {"form": "free"}
"""Detail of a variant that assumes no formula."""
POINTS = 61
"""Number of points of a published curve."""


def parameters(
    stem: str,
    force: float,
    torque: float,
    text: str,
    units: Sequence[str] = UNITS,
    bounds: tuple[float, float] = (-1e4, 1e4),
) -> tuple[Parameter, ...]:
    """Make parameters ``stem.fx`` … ``stem.tz`` with typical sizes ``force`` and ``torque``,
    described by ``text``. The bounds only refuse absurd values (estimates)."""
    return tuple(
        Parameter(f"{stem}.{c}", 0.0, u, force if c[0] == "f" else torque, *bounds, text)
        for c, u in zip(CHANNELS, units, strict=True)
    )


def variants(
    stems: Sequence[str], at: Values | None = None, shape: tuple[str, ...] = ()
) -> list[Variant]:
    """Variants that free ``stem.fx`` … of all ``stems``: of one channel, forces, torques, all; they
    begin at shape values ``at``, of which those named ``shape`` are fitted."""
    groups = (
        *((c, (c,), 1.0) for c in CHANNELS),
        ("forces", CHANNELS[:3], 2.0),
        ("torques", CHANNELS[3:], 1.0),
        ("all channels", CHANNELS, 3.0),
    )
    return [_freed(stems, *group, at=dict(at or {}), shape=shape) for group in groups]


def _freed(
    stems: Sequence[str], label: str, channels: Sequence[str], weight: float, **more: Any
) -> Variant:
    """Variant that frees ``stem.c`` of all stems in some channels c; ``more``: its other fields."""
    free = tuple(f"{stem}.{c}" for c in channels for stem in stems)
    detail = {"channel": label} if len(channels) == 1 else {}
    return Variant(label, free, detail=detail, weight=weight, **more)


def zero_and_gain_variants(
    zeros: Sequence[str],
    span: str,
    spans: Sequence[str],
    at: Values | None = None,
    shape: tuple[str, ...] = (),
) -> tuple[Variant, ...]:
    """Variants of a sensor that warms, freeing ``zeros`` (6 names), ``span`` (a gain), ``spans`` (6
    gains) or both; ``at``: start values of the shape, ``shape``: names of those fitted."""
    where = dict(at or {})
    *single, _, _, together = variants((zeros[0].partition(".")[0],), where, shape)
    return (
        *single,
        together,
        Variant("span", (span,), where, shape),
        Variant("span of each channel", tuple(spans), where, shape),
        *(
            Variant(f"{c} and all spans", (zero, *spans), where, shape, {"channel": c}, 0.5)
            for c, zero in zip(CHANNELS, zeros, strict=True)
        ),
        Variant("zero and span", (*zeros, *spans), where, shape, weight=2.0),
    )


def orders(stem: str, count: int) -> tuple[str, ...]:
    """Names ``stem1`` … ``stemN`` of a free curve's terms of order 1 to N = ``count``."""
    return tuple(f"{stem}{k}" for k in range(1, count + 1))


def falling(
    stem: str, sizes: Sequence[float], ratio: float, text: str, units: Sequence[str]
) -> tuple[Parameter, ...]:
    """Make parameters ``stem1.fx`` … of typical ``sizes`` (K,) by order, torques × ``ratio``."""
    return tuple(
        p
        for name, size in zip(orders(stem, len(sizes)), sizes, strict=True)
        for p in parameters(name, size, ratio * size, text, units)
    )


def free_variants(
    stems: Sequence[str], text: str, at: Values, channels: Sequence[str] = CHANNELS
) -> tuple[Variant, ...]:
    """Variants with a free curve in one channel, the forces, the torques or all: they free
    ``stem.fx`` … of all ``stems``; ``text`` begins labels, ``at`` are fixed shape values."""

    forces = [c for c in channels if c[0] == "f"]
    torques = [c for c in channels if c[0] == "t"]
    wide = (("forces", forces, 1.0), ("torques", torques, 0.5), ("all channels", channels, 1.5))
    groups = (*((c, (c,), 0.5) for c in channels), *(g for g in wide if len(g[1]) > 1))
    each = (_freed(stems, *group, at=at) for group in groups)
    return tuple(replace(v, label=f"{text}, {v.label}", detail={**FREE, **v.detail}) for v in each)


def curves(
    variant: Variant,
    x: np.ndarray | Callable[[str], np.ndarray],
    basis: Callable[[str, np.ndarray], np.ndarray],
    x_unit: str = "",
    y_unit: str = "",
) -> tuple[Curve, ...]:
    """Curves of a variant without a formula, one for each channel that it has amplitudes of, and
    one of a share that is added to all loads for its amplitudes of no channel.

    ``x`` is the grid (P,), or a function from a channel's name to it; ``basis`` is a function of an
    amplitude's name and grid to its contribution per SI unit (P,). Empty units are the channel's.
    """
    result = []
    for c, unit in zip(("", *CHANNELS), ("1", *UNITS), strict=True):
        names = tuple(n for n in variant.free if _channel(n) == c)
        if names:
            grid = x(c) if callable(x) else x
            columns = np.stack([basis(n, grid) for n in names], axis=1)
            result.append(Curve(c, names, grid, columns, x_unit or unit, y_unit or unit))
    return tuple(result)


def _channel(amplitude: str) -> str:
    """Channel with which the name of an amplitude ends; empty if with none."""
    ending = amplitude.rpartition(".")[2]
    return ending if ending in CHANNELS else ""


class ChannelEffect(ReadingEffect):
    """Effect on readings with one amplitude for each channel, ``stem.fx`` …; no other parameter."""

    channelwise = True
    stem: ClassVar[str]
    sizes: ClassVar[tuple[float, float]]
    """Typical amplitudes of forces and of torques."""
    units: ClassVar[Sequence[str]] = UNITS
    text: ClassVar[str]

    def parameters(self, robot: Robot) -> ParameterSet:
        return ParameterSet(parameters(self.stem, *self.sizes, self.text, self.units))

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        return tuple(variants((self.stem,)))
