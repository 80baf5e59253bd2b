"""The sensor's zero jumps once."""

import numpy as np

from wrenchbed.effects.base import (
    ReadingEffect,
    Values,
    Variant,
    channel_parameters,
    per_channel,
    vector,
)
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.parameters import Parameter

MOMENTS = 24
"""Largest number of moments at which a search begins; estimate."""
STEPS = per_channel("step")


class SensorJump(ReadingEffect):
    """y_i → y_i + s_i from ``time`` [s] on, a moment of the recording's clock.

    Seen in: varied orientations before and after its moment.
    """

    name = "sensor.jump"
    title = "the sensor's zero jumps once"
    channelwise = True
    rough = True
    zero_is_convention = True
    shown = "time"
    once = True
    source = "overload or a slipped bolt, 0.2–5 N: estimate"
    numbers = (
        *channel_parameters("step", 0.5, 0.02, "jump of the zero"),
        Parameter("time", 0.0, "s", 60.0, text="of the jump, as the recording's"),
    )

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        """Moments midway between two rows that were measured, evenly over the rows."""
        t = scene.t[scene.held]
        midway = (t[1:] + t[:-1]) / 2.0
        count = min(MOMENTS, len(midway))
        chosen = ((np.arange(count) + 0.5) * len(midway) / max(count, 1)).astype(int)
        return tuple(
            v
            for at in ({"time": float(m)} for m in midway[chosen])
            for v in (
                Variant("forces", STEPS[:3], at, ("time",)),
                Variant("all channels", STEPS, at, ("time",)),
            )
        )

    def read(self, scene: Scene, reading: np.ndarray, p: Values) -> np.ndarray:
        after = scene.t >= p["time"]
        return reading + after[:, None] * vector(p, STEPS)


EFFECT = SensorJump()
