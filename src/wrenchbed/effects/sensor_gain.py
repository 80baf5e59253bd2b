"""Axes of the sensor have a gain error."""

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


class SensorGain(ReadingEffect):
    """y_i → (1 + ε_i) y_i.

    Seen in: orientations that load each axis; a second payload, for with one a gain of all channels
    is a mass.
    """

    name = "sensor.gain"
    title = "axes of the sensor have a gain error"
    source = "0.2–1.5 %, ATI's stated uncertainty 0.75–1.5 % of full scale (unverified)"

    def parameters(self, robot: Robot) -> ParameterSet:
        text = "relative error of a channel"
        return ParameterSet(tuple(channel_parameters("gain", 0.01, 0.01, text, ["1"] * 6)))

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        return tuple(channel_variants("gain"))

    def read(self, scene: Scene, reading: np.ndarray, p: Values) -> np.ndarray:
        return reading * (1.0 + np.array([p[f"gain.{c}"] for c in CHANNELS]))


EFFECT = SensorGain()
