"""The sensor's zero is offset."""

import numpy as np

from wrenchbed.effects.base import (
    ReadingEffect,
    Values,
    Variant,
    channel_parameters,
    channel_variants,
)
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.parameters import ParameterSet
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.base import Robot


class SensorBias(ReadingEffect):
    """y_i → y_i + b_i [N, N·m].

    Seen in: any poses that turn the tool about.
    """

    name = "sensor.bias"
    title = "the sensor's zero is offset"
    source = "0.1–5 N and 5–100 mN·m, engineering memory"

    def parameters(self, robot: Robot) -> ParameterSet:
        return ParameterSet(tuple(channel_parameters("bias", 1.0, 0.05, "reading without load")))

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        return tuple(channel_variants("bias"))

    def read(self, scene: Scene, reading: np.ndarray, p: Values) -> np.ndarray:
        return reading + np.array([p[f"bias.{c}"] for c in CHANNELS])


EFFECT = SensorBias()
