"""The sensor's zero drifts steadily."""

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


class SensorDrift(ReadingEffect):
    """y_i → y_i + d_i (t − t₀), zero at the first row.

    The typical rates, 1e-4 N/s = 0.36 N/h and 2e-6 N·m/s = 7 mN·m/h, add up to 0.03 N and
    0.6 mN·m in five minutes.

    Seen in: a first pose that is visited again, in an order of poses that is mixed.
    """

    name = "sensor.drift"
    title = "the sensor's zero drifts steadily"
    size_error = 0.1
    source = "0.05–0.5 N/h and 1–10 mN·m/h, engineering memory"

    def parameters(self, robot: Robot) -> ParameterSet:
        units = ["N/s"] * 3 + ["N·m/s"] * 3
        text = "change of the zero in time"
        return ParameterSet(tuple(channel_parameters("rate", 1e-4, 2e-6, text, units)))

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        return tuple(channel_variants("rate"))

    def read(self, scene: Scene, reading: np.ndarray, p: Values) -> np.ndarray:
        return reading + scene.age[:, None] * np.array([p[f"rate.{c}"] for c in CHANNELS])


EFFECT = SensorDrift()
