"""Effect ``sensor.creep``: the sensor's reading creeps after its load has changed."""

import numpy as np

from wrenchbed.effects import by_channel
from wrenchbed.effects.base import Curve, ReadingEffect, Values, Variant, alike, per_channel, vector
from wrenchbed.effects.drives.operators import lagging
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.model_parameters import Parameter

TAUS = (30.0, 150.0, 600.0)
"""Time constants where a search begins [s]: steps of four to five, from a hold to a recording."""
RELAXATIONS_S = (2.0, 6.0, 20.0, 60.0, 200.0, 600.0)
"""Time constants of which a free form is a sum [s]: half a decade apart, so without ripple."""
RELAX = by_channel.orders("relax", len(RELAXATIONS_S))
ALIKE = tuple(f"{n}.all" for n in RELAX)
SHARE = 3e-3
"""Typical share of a load that comes late: that of a poor data sheet, see ``source``."""


class SensorCreep(ReadingEffect):
    """y_i → y_i + c_i ∫h(t − s) ẏ_i ds, h(t) = 1 − exp(−t/τ): after a step of load by Δ the
    reading is right at first and ends c_i Δ too high; with ``late`` = 1 it starts c_i Δ too low and
    ends right, as a sensor reads that was calibrated when it had settled.

    Free: a sum of such relaxations of given time constants (Prony's series: Tschoegl, The
    Phenomenological Theory of Linear Viscoelastic Behavior, 1989, ch. 3).

    Settled at the first row; the load moves linearly from row to row, over which ∫ is exact.

    Seen in: long holds after changes of load, and a first pose that is visited again.
    """

    name = "sensor.creep"
    title = "the sensor's reading creeps after its load has changed"
    channelwise = True
    form_error = 0.15
    size_error = 0.15
    zero_is_convention = True
    shown = "time"
    source = (
        "0.05–0.1 % of the load in 30 min (strain-gauge data sheets); three times that: a poor one"
    )
    numbers = (
        *by_channel.parameters("share", SHARE, SHARE, "of a load, added in the end", "1" * 6),
        Parameter("tau", TAUS[1], "s", 150.0, 1e-2, 1e6, "time constant"),
        *by_channel.falling("relax", (SHARE,) * len(RELAX), 1.0, "share of a relaxation", "1" * 6),
        *alike(ALIKE, "1", SHARE, 1e4, "share of it in all channels"),
        Parameter("late", 0.0, "1", 1.0, 0.0, 1.0, "right in the end, not at first"),
    )

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        return tuple(
            v
            for tau in TAUS
            for late in (0.0, 1.0)
            for v in by_channel.variants(("share",), {"tau": tau, "late": late}, ("tau",))
        )

    def free_forms(self, scene: Scene) -> tuple[Variant, ...]:
        result = list[Variant]()
        for late, when in ((0.0, "right at first"), (1.0, "right in the end")):
            at, text = {"late": late}, f"any creep, {when}"
            result += by_channel.free_variants(RELAX, text, at)
            result.append(Variant(f"{text}, alike", ALIKE, at, (), by_channel.FREE))
        return tuple(result)

    def curves(self, scene: Scene, variant: Variant) -> tuple[Curve, ...]:
        """Curves over time of the reading's creep after a unit step of load."""
        t, late = np.linspace(0.0, scene.span, by_channel.POINTS), variant.at["late"]

        def basis(name: str, t: np.ndarray) -> np.ndarray:
            tau = RELAXATIONS_S[RELAX.index(name.partition(".")[0])]
            return np.asarray(1.0 - late - np.exp(-t / tau))

        return by_channel.curves(variant, t, basis, "s", "1")

    def read(self, scene: Scene, reading: np.ndarray, p: Values) -> np.ndarray:
        end = reading[0] + p["late"] * (reading - reading[0])
        result = reading.copy()
        share = vector(p, per_channel("share"))
        parts = [(p["tau"], share)]
        for tau, name in zip(RELAXATIONS_S, RELAX, strict=True):
            parts.append((tau, vector(p, per_channel(name)) + p[f"{name}.all"]))
        for tau, part in parts:
            on = np.flatnonzero(part)
            if len(on):
                settled = lagging(reading[:, on], scene.t, tau)
                result[:, on] += part[on] * (settled - end[:, on])
        return result


EFFECT = SensorCreep()
