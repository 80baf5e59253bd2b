"""Effect ``sensor.hysteresis``: the sensor's reading depends on its earlier loads."""

from dataclasses import replace

import numpy as np

from wrenchbed.effects import by_channel
from wrenchbed.effects.base import Curve, ReadingEffect, Values, Variant, per_channel, vector
from wrenchbed.effects.drives.operators import stop
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.model_parameters import Parameter
from wrenchbed.physics.wrench import CHANNELS, UNITS

WIDTHS = {"narrow": 0.04, "middle": 0.15, "wide": 0.5}
"""Half widths of the play operators, relative to a channel's range in the recording: steps of three
to four, which overlap in shape."""
PLAYS = (0.02, 0.06, 0.12, 0.25, 0.45, 0.75)
"""Half widths of the play operators of a free form, relative to a channel's range: steps of two,
which overlap in shape."""
TURNED = (1, 3)
"""Indices of the plays in `PLAYS` whose lag may also turn with the load: one narrow, one wide."""
LAGS = (*(f"play{k + 1}" for k in range(len(PLAYS))), *(f"turn{k + 1}" for k in range(len(TURNED))))
FORMS = tuple(f"{w}{s}" for w in WIDTHS for s in ("", ".slope"))


class SensorHysteresis(ReadingEffect):
    """y_i → y_i + Σ_w (h_iw + s_iw u_i) (play_w(y_i) − y_i)/w: a lag that turns with the load.

    At rest the y_i of the loops also pass through the inertial loads of the moves between poses,
    times a ``pace``: 1 at the joints' top speeds, 0 of slow moves.

    The play operator follows its input once it is w behind; a sum of plays of several widths is
    the Prandtl–Ishlinskii form of hysteresis (Visintin, Differential Models of Hysteresis, 1994,
    ch. III). h_iw is the largest lag of a play; with the slope s_iw it grows along the load u_i,
    −1 … 1 over the channel's range. Real loops have other forms still: see ``form_error``.

    Seen in: poses approached from both directions of load.
    """

    name = "sensor.hysteresis"
    title = "the sensor's reading depends on its earlier loads"
    channelwise = True
    sized_by_change = True
    shown = "loop"
    size_error = 0.2
    zero_is_convention = True
    source = "0.1–0.3 % of full scale, strain-gauge data sheets"
    form_error = 0.45
    numbers = (
        *(p for f in FORMS for p in by_channel.parameters(f, 0.1, 0.01, "largest lag of a play")),
        Parameter("width", 1.0, "1", 0.2, 0.1, 4.0, "factor of all widths"),
        Parameter("pace", 0.0, "1", 0.3, 0.0, 4.0, "of the moves' accelerations between poses"),
        *by_channel.falling(
            "play", (0.05,) * len(PLAYS), 0.1, "largest lag of a free form's play", UNITS
        ),
        *by_channel.falling(
            "turn", (0.05,) * len(TURNED), 0.1, "the same, growing along the load", UNITS
        ),
    )

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        slow = by_channel.variants(FORMS, {"width": 1.0}, ("width",))
        if not scene.jolts.any():
            return tuple(slow)
        at = {"width": 1.0, "pace": 1.0}
        brisk = (replace(v, label=f"{v.label}, brisk moves", at=at, shape=tuple(at)) for v in slow)
        return tuple(v for both in zip(slow, brisk, strict=True) for v in both)

    def usual(self, variant: Variant) -> tuple[str, ...]:
        return tuple(n for n in variant.free if n.startswith("middle.") and ".slope" not in n)

    def free_forms(self, scene: Scene) -> tuple[Variant, ...]:
        slow = by_channel.free_variants(LAGS, "any loop", {"pace": 0.0})
        brisk = by_channel.free_variants(LAGS, "any loop, brisk moves", {"pace": 1.0})
        return (*slow, *brisk) if scene.jolts.any() else slow

    def curves(self, scene: Scene, variant: Variant) -> tuple[Curve, ...]:
        """Curves of the reading's lag over load, from the smallest to the largest and back."""
        there = np.linspace(-1.0, 1.0, by_channel.POINTS)
        way = np.concatenate([there, there[::-1], there, there[::-1]])  # settled the second time
        low, high = scene.load.min(axis=0), scene.load.max(axis=0)

        def load(c: str) -> np.ndarray:
            k = CHANNELS.index(c)
            middle, half = (low[k] + high[k]) / 2.0, (high[k] - low[k]) / 2.0
            return np.asarray(middle + half * way[2 * by_channel.POINTS :])

        def basis(name: str, x: np.ndarray) -> np.ndarray:
            u = way[:, None]
            lag = -stop(u, 2.0 * _width(name)) * (u if _turned(name) else 1.0)
            return np.asarray(lag[2 * by_channel.POINTS :, 0])

        return by_channel.curves(variant, load, basis)

    def read(self, scene: Scene, reading: np.ndarray, p: Values) -> np.ndarray:
        sizes = {n: vector(p, per_channel(n)) for n in (*FORMS, *LAGS)}
        used = {n: np.flatnonzero(size) for n, size in sizes.items() if size.any()}
        if not used:
            return reading
        low, high = reading.min(axis=0), reading.max(axis=0)
        extent = np.maximum(high - low, 1e-9)
        inputs = reading + p["pace"] * scene.jolts if p["pace"] else reading
        u = (2.0 * inputs - (low + high)) / extent
        result = reading.copy()
        for name, on in used.items():
            width = _width(name) * (p["width"] if name in FORMS else 1.0)
            growth = u[:, on] if _turned(name) else 1.0
            result[:, on] -= sizes[name][on] * growth * stop(u[:, on], 2.0 * width)
        return result


def _width(name: str) -> float:
    """Half width of the play operator in an amplitude's name, as a share of the channel's range."""
    stem = name.partition(".")[0]
    if stem in WIDTHS:
        return WIDTHS[stem]
    place = int(stem[-1]) - 1
    return PLAYS[TURNED[place] if stem.startswith("turn") else place]


def _turned(name: str) -> bool:
    """Whether a hysteresis amplitude is a slope, by which the lag grows along the load."""
    return ".slope" in name or name.startswith("turn")


EFFECT = SensorHysteresis()
