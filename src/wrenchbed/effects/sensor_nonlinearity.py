"""The sensor's readings are nonlinear in the load."""

from dataclasses import replace

import numpy as np

from wrenchbed.effects.base import (
    ReadingEffect,
    Values,
    Variant,
    channel_parameters,
    channel_variants,
    per_channel,
    vector,
)
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.parameters import Parameter

REFERENCE = np.array([20.0, 20.0, 20.0, 2.0, 2.0, 0.2])
"""Load (6,) at which an amplitude is the relative error [N, N·m]: the full scale of a small sensor.
Fixed by definition, so that the number does not depend on the range of the sensor."""
LAWS = ("even", "odd")
TEXT = "relative error at 20 N, 2 N·m (z: 0.2)"
BEGIN = {"even": ("even", 2.0), "odd": ("odd", 3.0), "gain by sign": ("even", 1.0)}
"""Laws and powers of the load at which a search begins."""


class SensorNonlinearity(ReadingEffect):
    """y_i → y_i + Y_i |y_i/Y_i|ⁿ (e_i + o_i sgn y_i) with Y = 20 N, 2 N·m (z: 0.2), n about 2 or 3;
    an even law with n = 1 is a gain that differs between push and pull.

    Even: the same sign under both directions of load; odd: the gain depends on the load. The
    typical 0.005 is 0.1 N at 20 N, and 0.025 N (even) or 6 mN (odd) at 10 N.

    Seen in: inverted poses for the even law, loads near full scale for the odd one; a second
    payload.
    """

    name = "sensor.nonlinearity"
    title = "the sensor's readings are nonlinear in the load"
    size_error = 0.1
    source = "0.1–0.3 % of full scale at full scale; 0.2 %: FRB load ring data sheet"
    numbers = (
        *channel_parameters("even", 5e-3, 5e-3, TEXT, "1" * 6),
        *channel_parameters("odd", 5e-3, 5e-3, TEXT, "1" * 6),
        Parameter("power", 2.0, "1", 0.2, 0.8, 5.0, "power of the load"),
    )

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        return tuple(
            replace(v, label=f"{text}, {v.label}", detail={"law": text, **v.detail})
            for text, (law, power) in BEGIN.items()
            for v in channel_variants(law, {"power": power}, ("power",))
        )

    def read(self, scene: Scene, reading: np.ndarray, p: Values) -> np.ndarray:
        even, odd = (vector(p, per_channel(law)) for law in LAWS)
        relative = reading / REFERENCE
        bend = np.abs(relative) ** p["power"] * REFERENCE
        return np.asarray(reading + bend * (even + odd * np.sign(reading)))


EFFECT = SensorNonlinearity()
