"""The sensor's reading depends on its earlier loads."""

from collections.abc import Mapping
from typing import Any

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
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.base import Robot

WIDTHS = {"narrow": 0.04, "middle": 0.15, "wide": 0.5}
"""Half widths of the play operators, relative to a channel's range in the recording; estimates."""
FORMS = tuple(f"{w}{s}" for w in WIDTHS for s in ("", ".slope"))


class SensorHysteresis(ReadingEffect):
    """y_i → y_i + Σ_w (h_iw + s_iw u_i) (play_w(y_i) − y_i)/w: a lag that turns with the load.

    The play operator follows its input once it is w behind; a sum of plays of several widths is
    the Prandtl–Ishlinskii form of hysteresis (Visintin, Differential Models of Hysteresis, 1994,
    ch. III). h_iw is the largest lag of a play; with the slope s_iw it grows along the load u_i,
    −1 … 1 over the channel's range. Real loops have other forms still: see ``form_error``.

    Seen in: poses approached from both directions of load.
    """

    name = "sensor.hysteresis"
    title = "the sensor's reading depends on its earlier loads"
    size_error = 0.2
    zero_is_convention = True
    source = "0.1–0.3 % of full scale, strain-gauge data sheets"
    form_error = 0.45
    numbers = (
        *(p for f in FORMS for p in channel_parameters(f, 0.1, 0.01, "largest lag of a play")),
        Parameter("width", 1.0, "1", 0.2, 0.1, 4.0, "factor of all widths"),
    )

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        def of(label: str, channels: tuple[str, ...], weight: float = 1.0) -> Variant:
            free = tuple(f"{f}.{c}" for c in channels for f in FORMS)
            detail = {"channel": label} if len(channels) == 1 else {}
            return Variant(label, free, {"width": 1.0}, ("width",), detail, weight)

        single = [of(c, (c,)) for c in CHANNELS]
        return (
            *single,
            of("forces", CHANNELS[:3], 2.0),
            of("torques", CHANNELS[3:]),
            of("all channels", CHANNELS, 3.0),
        )

    def usual(self, variant: Variant) -> tuple[str, ...]:
        return tuple(n for n in variant.free if n.startswith("middle.") and ".slope" not in n)

    def read(self, scene: Scene, reading: np.ndarray, p: Values) -> np.ndarray:
        lag = np.array([vector(p, per_channel(w)) for w in WIDTHS])  # (widths, 6)
        slope = np.array([vector(p, per_channel(f"{w}.slope")) for w in WIDTHS])
        which, on = np.nonzero((lag != 0) | (slope != 0))
        if not len(on):
            return reading
        low, high = reading.min(axis=0), reading.max(axis=0)
        extent = np.maximum(high - low, 1e-9)
        width = np.array(list(WIDTHS.values()))[which] * extent[on] * p["width"]
        x = reading[:, on]
        u = (2.0 * x - (low + high)[on]) / extent[on]
        behind = (lag[which, on] + slope[which, on] * u) * (play(x, width) - x) / width
        result = reading.copy()
        np.add.at(result.T, on, behind.T)
        return result

    def values(self, robot: Robot, given: Mapping[str, Any]) -> dict[str, float]:
        """Also takes ``lag.fx=0.1``: the middle play of a channel."""
        short = dict(zip(per_channel("lag"), per_channel("middle"), strict=True))
        return super().values(robot, {short.get(k, k): v for k, v in given.items()})


def play(x: np.ndarray, width: np.ndarray) -> np.ndarray:
    """The play operator along the rows of (M, K) with half widths (K,)."""
    result = np.empty_like(x)
    for k, half in enumerate(width.tolist()):
        at, path = float(x[0, k]), []
        for value in x[:, k].tolist():
            at = value - half if at < value - half else value + half if at > value + half else at
            path.append(at)
        result[:, k] = path
    return result


EFFECT = SensorHysteresis()
