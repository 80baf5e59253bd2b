"""Effect ``sensor.crosstalk``: a channel responds to the load of other channels."""

from itertools import permutations

import numpy as np

from wrenchbed.effects.base import ReadingEffect, Values, Variant, alike, vector
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.rotations import cross
from wrenchbed.physics.wrench import CHANNELS

PAIRS = tuple(permutations(CHANNELS, 2))
"""The channel that shows, and the one of which it shows something: 30 pairs."""
SIZES = {"ff": ("1", 0.01), "tf": ("m", 5e-4), "ft": ("1/m", 0.03), "tt": ("1", 0.01)}
"""Unit and typical size of force from force, torque from force, force from torque, torque from
torque: about ATI's stated uncertainty of 1 % of full scale, by the ratio of full scales."""
ORIGIN = tuple(f"origin.{a}" for a in "xyz")


class SensorCrosstalk(ReadingEffect):
    """F → F + X_FF F + X_FT T, T → T + X_TF F + X_TT T + r × F, of the forces and torques read.

    ``x.fx.ty`` is what fx shows per ty. ``origin`` r is the shift of the sensing origin: the
    antisymmetric part of X_TF, three numbers instead of nine.

    Seen in: varied orientations; a second payload, since with one payload torque from force looks
    like a shift of the CoG.
    """

    name = "sensor.crosstalk"
    title = "a channel responds to the load of other channels"
    shown = "matrix"
    source = (
        "0.2–1 % between like channels, 0.1–1 mm torque from force, 0.005–0.05 N per N·m force "
        "from torque; origin 1–6 mm (a Mini40's, if forgotten, 5.36 mm): estimate"
    )
    numbers = (
        *(
            p
            for shows, of in PAIRS
            for unit, size in (SIZES[shows[0] + of[0]],)
            for p in alike((f"x.{shows}.{of}",), unit, size, 10.0, f"what {shows} shows per {of}")
        ),
        *alike(ORIGIN, "m", 1e-3, 1.0, "shift of the sensor's origin: it adds r × F"),
    )

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        names = {pair: f"x.{pair[0]}.{pair[1]}" for pair in PAIRS}
        single = [
            Variant(f"{shows} from {of}", (n,), detail={"channel": shows, "of": of})
            for (shows, of), n in names.items()
        ]
        word = {"f": "forces", "t": "torques"}
        blocks = [
            Variant(
                f"{word[block[0]]} from {word[block[1]]}",
                tuple(n for (s, o), n in names.items() if s[0] + o[0] == block),
            )
            for block in SIZES
        ]
        return (
            *single,
            *blocks,
            Variant("shifted origin", ORIGIN),
            Variant("everything", tuple(names.values())),
        )

    def read(self, scene: Scene, reading: np.ndarray, p: Values) -> np.ndarray:
        x = np.array([[p.get(f"x.{s}.{o}", 0.0) for o in CHANNELS] for s in CHANNELS])
        force = reading[:, :3]
        shift = vector(p, ORIGIN)
        result = reading + reading @ x.T
        result[:, 3:] += cross(np.broadcast_to(shift, force.shape), force)
        return result


EFFECT = SensorCrosstalk()
