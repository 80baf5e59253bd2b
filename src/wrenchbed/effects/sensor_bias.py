"""Effect ``sensor.bias``: the sensor's zero is offset."""

import numpy as np

from wrenchbed.effects import by_channel
from wrenchbed.effects.base import Values, per_channel, vector
from wrenchbed.effects.scene import Scene


class SensorBias(by_channel.ChannelEffect):
    """y_i → y_i + b_i, y_i the reading of channel i [N, N·m].

    Seen in: any poses that turn the tool about.
    """

    name = "sensor.bias"
    title = "the sensor's zero is offset"
    source = "0.1–5 N and 5–100 mN·m, estimate"
    stated = "bias"
    stem, sizes, text = "bias", (1.0, 0.05), "reading without load"

    def read(self, scene: Scene, reading: np.ndarray, p: Values) -> np.ndarray:
        return reading + vector(p, per_channel("bias"))


EFFECT = SensorBias()
