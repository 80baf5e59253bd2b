"""A wrench beside the joint efforts: six more channels, which see the tool that the joints carry.

Tool and tilt of the base have columns in all channels, so that both kinds of data testify together.
What only the sensor sees is ordinary, or has no name here: ``diagnose`` of the wrench names it.
"""

import numpy as np

from wrenchbed.diagnosis.efforts.columns import STRETCHES
from wrenchbed.effects.drives.base import Block, Column
from wrenchbed.effects.drives.operators import late
from wrenchbed.physics.wrench import CHANNELS

_GAIN = 0.01
"""Ordinary error of a gain and of crosstalk among forces, or among moments; estimate."""
_LATE = 4e-3
"""Delay at which the column of a free one is made [s]; estimate."""


def of_channel(total: np.ndarray, t: np.ndarray, channel: int, first: int) -> tuple[
    list[Column], list[Block]
]:  # fmt: skip
    """Columns (N,) and causes without a name of one channel.

    Args:
        total: predicted wrench (N, 6).
        t: times (N,) [s].
        channel: from 0.
        first: number of the first channel of the wrench among all, from 1.
    """
    name = CHANNELS[channel]
    alike = range(3) if channel < 3 else range(3, 6)
    columns = [
        Column(f"bias.{name}", np.ones(len(t)), free=True),
        Column(f"late.{name}", late(total[:, channel], t, _LATE), free=True),
        *(Column(f"gain.{name}.{CHANNELS[k]}", total[:, k], _GAIN) for k in alike),
    ]
    place = (t - t[0]) / (t[-1] - t[0]) * (STRETCHES - 1)
    drift = [
        Column(f"drift.{name}.{k}", np.maximum(1.0 - np.abs(place - k), 0.0))
        for k in range(1, STRETCHES)
    ]
    others = [Column(f"of.{name}.{CHANNELS[k]}", total[:, k]) for k in range(6) if k not in alike]
    number = first + channel
    blocks = [
        Block("zero in time", number, True, tuple(c.name for c in drift)),
        Block("crosstalk", number, True, tuple(c.name for c in others)),
        Block("gain", number, True, tuple(f"gain.{name}.{CHANNELS[k]}" for k in alike)),
    ]
    return [*columns, *drift, *others], blocks
