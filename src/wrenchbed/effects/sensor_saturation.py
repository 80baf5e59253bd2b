"""Effect ``sensor.saturation``: a channel saturates at a level."""

import numpy as np

from wrenchbed import registry
from wrenchbed.effects import by_channel
from wrenchbed.effects.base import ReadingEffect, Values, Variant, per_channel, vector
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.model_parameters import Parameter, ParameterSet
from wrenchbed.physics.wrench import CHANNELS, UNITS, wrench
from wrenchbed.robots.base import Robot

QUANTILES = (0.7, 0.85, 0.95)
"""Quantiles of a channel's absolute load where a search for its level begins: at a lower level most
rows would be saturated."""


class SensorSaturation(ReadingEffect):
    """y_i → y_i + s_i (clip(y_i, ±L_i) − y_i), y_i the reading of channel i.

    The share s_i is 0 where nothing is clipped and 1 where the channel never passes its level L_i
    [N, N·m]; it makes the reading linear. Between the two a channel bends at its level.

    Seen in: poses that load the channel beyond its level: flat tops in one channel.
    """

    name = "sensor.saturation"
    title = "a channel saturates at a level"
    channelwise = True
    shown = "load"
    form_error = 0.1
    size_error = 0.02
    source = "converters end at 105 % of range, wrong range or gain settings far earlier: estimate"

    def parameters(self, robot: Robot) -> ParameterSet:
        full = registry.load("sensors", robot.sensor).calibration().range
        text, bounds = "1: the channel is clipped fully", (-10.0, 10.0)
        shares = by_channel.parameters("share", 1.0, 1.0, text, "1" * 6, bounds)
        levels = [
            Parameter(f"level.{c}", float(r), u, 0.3 * float(r), 1e-6, 1e5, "largest |reading|")
            for c, r, u in zip(CHANNELS, full, UNITS, strict=True)
        ]
        return ParameterSet((*shares, *levels))

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        load = np.abs(wrench(*scene.pose, scene.tool, scene.gravity)[scene.held])
        result = []
        groups: dict[str, tuple[str, ...]] = {c: (c,) for c in CHANNELS}
        groups |= {"forces": CHANNELS[:3], "torques": CHANNELS[3:], "all": CHANNELS}
        for label, group in groups.items():
            for levels in np.quantile(load, QUANTILES, axis=0).tolist():
                level = dict(zip(CHANNELS, levels, strict=True))
                at = {f"level.{c}": level[c] for c in group if level[c] > 1e-5}
                if len(at) > (len(group) > 1):
                    free = tuple(n.replace("level", "share") for n in at)
                    detail = {"channel": label} if len(group) == 1 else {}
                    result.append(Variant(label, free, at, tuple(at), detail))
        return tuple(result)

    def read(self, scene: Scene, reading: np.ndarray, p: Values) -> np.ndarray:
        share, level = vector(p, per_channel("share")), vector(p, per_channel("level"))
        return reading + share * (np.clip(reading, -level, level) - reading)


EFFECT = SensorSaturation()
