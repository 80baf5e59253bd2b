"""Effect ``tool.leak``: the tool loses or gains mass while it is recorded."""

from dataclasses import replace

import numpy as np

from wrenchbed.effects.base import (
    LoadEffect,
    Pose,
    Residual,
    Sizes,
    Values,
    Variant,
    alike,
    course,
    half_waves,
    vector,
    waves,
)
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.model_parameters import Parameter
from wrenchbed.physics.wrench import Tool, wrench

PLACE = ("place.x", "place.y", "place.z")
FREE = waves("wave")
SCANNED = 3000
"""Number of rows in which a scan looks for the place: as many as need less than a second."""
FARTHEST = 0.5
"""Distance of the place from the tool's CoG beyond which it is none [m]: tools are shorter."""


class ToolLeak(LoadEffect):
    """m → m − r (t − t₀) − Σ_k w_k sin(kπ (t − t₀)/D), k = 1 … 5: m the tool's mass.

    It is a point mass at the tool's CoG plus ``place`` in sensor axes; in motion its inertia goes
    with it. Without waves the loss is steady; with them it is any smooth function of time, whose
    typical size falls with 1/k². D is the recording's duration.

    Seen in: a payload that drips, evaporates or fills up, in orientations whose order is mixed; a
    first pose that is visited again. With the lost mass on the line from the sensor's origin to the
    CoG it is a gain of all channels that drifts.
    """

    name = "tool.leak"
    title = "the tool loses or gains mass while it is recorded"
    size_error = 0.1
    zero_is_convention = True
    shown = "time"
    source = "3 g/min, a coolant nozzle or a glue tip that drips: estimate"
    numbers = (
        *alike(("rate",), "kg/s", 5e-5, 10.0, "mass lost in time"),
        *(
            Parameter(n, 0.0, "kg", 5e-3 / k**2, -50.0, 50.0, f"mass lost, {k} half waves")
            for k, n in enumerate(FREE, start=1)
        ),
        *alike(PLACE, "m", 0.02, 1.0, "of the lost mass, from the tool's CoG"),
        Parameter("duration", 300.0, "s", 60.0, 1e-3, 1e8, "of the half waves"),
    )

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        at = dict.fromkeys(PLACE, 0.0)
        free = at | {"duration": scene.span}
        return (
            Variant("steady", ("rate",), at, PLACE),
            Variant("any course", ("rate", *FREE), free, PLACE, {"form": "free"}),
        )

    def scan(self, scene: Scene, residual: Residual) -> tuple[Variant, ...]:
        """Variants whose place s (3,) [m] of lost mass a(t) explains a residual best; its wrench
        a u + Σ_i a s_i l_i (known u, l_i) is linear in a and a s."""
        pose = Pose(*scene.pose)
        rows = residual.rows[:: 1 + len(residual.rows) // SCANNED]
        value = residual.value[:: 1 + len(residual.rows) // SCANNED]
        unit = per_kilogram(scene, pose, scene.tool.cog)[rows]
        levers = [per_kilogram(scene, pose, scene.tool.cog + e)[rows] - unit for e in np.eye(3)]
        parts = np.stack([unit, *levers], axis=-1) / residual.noise[:, None]  # (R, 6, 4)
        even = scene.age[rows, None] / scene.span
        free = half_waves(scene, scene.span)[rows]
        result = []
        both = (even, np.hstack([even, free]))
        for variant, courses in zip(self.variants(scene), both, strict=True):
            along = np.hstack([courses, np.ones_like(even)])  # the last is a wrong mass and CoG
            columns = np.einsum("rc,rki->rkci", along, parts).reshape(value.size, -1)
            bias = np.tile(np.eye(6), (len(rows), 1))
            design = np.hstack([columns, bias])
            fitted = np.linalg.lstsq(design, value.ravel(), rcond=None)[0][: columns.shape[1]]
            lost, moment = np.split(fitted.reshape(-1, 4)[:-1], [1], axis=1)
            place = (lost.T @ moment)[0] / max(float((lost**2).sum()), 1e-12)
            if np.linalg.norm(place) < FARTHEST:
                at = dict(variant.at) | dict(zip(PLACE, map(float, place), strict=True))
                text = f"{variant.label}, away from the CoG"
                result.append(replace(variant, label=text, at=at, weight=0.5))
        return tuple(result)

    def size(self, scene: Scene, variant: Variant, p: Values) -> Sizes:
        lost = course(scene, p, "rate", FREE)
        return {"lost": (float(lost[np.abs(lost).argmax()]), "kg")}

    def pull(self, scene: Scene, pose: Pose, load: np.ndarray, p: Values) -> np.ndarray:
        """Wrench (M, 6) [N, N·m] that the lost mass no longer puts on the sensor, negative."""
        lost = course(scene, p, "rate", FREE)
        return -lost[:, None] * per_kilogram(scene, pose, scene.tool.cog + vector(p, PLACE))


def per_kilogram(scene: Scene, pose: Pose, place: np.ndarray) -> np.ndarray:
    """Wrench (M, 6) [N/kg, N·m/kg] of a point mass at a place (3,) [m] in sensor axes."""
    point = Tool(np.ones(()), place, np.zeros((3, 3)), np.zeros(()))
    return wrench(*pose, point, scene.gravity)


EFFECT = ToolLeak()
