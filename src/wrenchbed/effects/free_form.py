"""Parameters, variants and curves of effects without a formula: many linear amplitudes, smaller by
order. A fit's evidence pays for each that data determine, so a formula that fits is preferred.
Numbers of points and weights are estimates.
"""

from collections.abc import Callable, Sequence

import numpy as np

from wrenchbed.effects.base import Curve, Values, Variant, channel_parameters
from wrenchbed.physics.model_parameters import Parameter
from wrenchbed.physics.wrench import CHANNELS, UNITS

FREE = {"form": "free"}
"""Detail of a variant that assumes no formula."""
POINTS = 61
"""Number of points of a published curve."""


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
        for p in channel_parameters(name, size, ratio * size, text, units)
    )


def free_variants(
    stems: Sequence[str], text: str, at: Values, channels: Sequence[str] = CHANNELS
) -> tuple[Variant, ...]:
    """Variants with a free curve in one channel, the forces, the torques or all: they free
    ``stem.fx`` … of all ``stems``; ``text`` begins labels, ``at`` are fixed shape values."""

    def of(label: str, group: Sequence[str], share: float) -> Variant:
        free = tuple(f"{stem}.{c}" for c in group for stem in stems)
        detail = FREE | ({"channel": label} if len(group) == 1 else {})
        return Variant(f"{text}, {label}", free, at, (), detail, share)

    forces = [c for c in channels if c[0] == "f"]
    torques = [c for c in channels if c[0] == "t"]
    groups = (("forces", forces, 1.0), ("torques", torques, 0.5), ("all channels", channels, 1.5))
    wide = [of(label, group, share) for label, group, share in groups if len(group) > 1]
    return (*(of(c, (c,), 0.5) for c in channels), *wide)


def channel_curves(
    variant: Variant,
    x: np.ndarray | Callable[[str], np.ndarray],
    basis: Callable[[str, np.ndarray], np.ndarray],
    x_unit: str = "",
    y_unit: str = "",
) -> tuple[Curve, ...]:
    """Curves of a variant without a formula, one for each channel that it has amplitudes of.

    ``x`` is the grid (P,), or a function from a channel's name to it; ``basis`` is a function of an
    amplitude's name and grid to its contribution per SI unit (P,). Empty units are the channel's.
    """
    result = []
    for c, unit in zip(CHANNELS, UNITS, strict=True):
        names = tuple(n for n in variant.free if n.endswith(f".{c}"))
        if names:
            grid = x(c) if callable(x) else x
            columns = np.stack([basis(n, grid) for n in names], axis=1)
            result.append(Curve(c, names, grid, columns, x_unit or unit, y_unit or unit))
    return tuple(result)


def share_curve(
    variant: Variant, x: np.ndarray, basis: Callable[[str, np.ndarray], np.ndarray], x_unit: str
) -> tuple[Curve, ...]:
    """Curve over x (P,) of a share added to all loads; basis(name, x) → (P,) of each amplitude."""
    columns = np.stack([basis(n, x) for n in variant.free], axis=1)
    return (Curve("", variant.free, x, columns, x_unit, "1"),)
