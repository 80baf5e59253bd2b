"""The sensor's zero drifts steadily."""

import numpy as np

from wrenchbed.effects.base import ChannelEffect, Values, per_channel, vector
from wrenchbed.effects.scene import Scene


class SensorDrift(ChannelEffect):
    """y_i → y_i + d_i (t − t₀), zero at the first row.

    The typical rates, 1e-4 N/s = 0.36 N/h and 2e-6 N·m/s = 7 mN·m/h, add up to 0.03 N and
    0.6 mN·m in five minutes.

    Seen in: a first pose that is visited again, in an order of poses that is mixed.
    """

    name = "sensor.drift"
    title = "the sensor's zero drifts steadily"
    size_error = 0.1
    source = "0.05–0.5 N/h and 1–10 mN·m/h, estimate"
    zero_is_convention = True
    over_time = True
    once = True
    stem, sizes, text = "rate", (1e-4, 2e-6), "change of the zero in time"
    units = ("N/s",) * 3 + ("N·m/s",) * 3

    def read(self, scene: Scene, reading: np.ndarray, p: Values) -> np.ndarray:
        return reading + scene.age[:, None] * vector(p, per_channel("rate"))


EFFECT = SensorDrift()
