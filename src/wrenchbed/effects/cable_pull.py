"""A cable or hose pulls on the tool."""

from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from wrenchbed.effects.base import LoadEffect, Pose, Values, Variant
from wrenchbed.frames import apply, cross
from wrenchbed.jets import value
from wrenchbed.parameters import Parameter, ParameterSet
from wrenchbed.robots.base import Robot
from wrenchbed.scene import Scene

if TYPE_CHECKING:
    import mujoco

POINT = ("point.x", "point.y", "point.z")
REACHES = (0.6, 1.3)
"""How far from the middle of the recorded positions the anchors lie where a search begins [m]."""


class CablePull(LoadEffect):
    """F = k (a − p)(1 − L/|a − p|)₊ + f₀ at a point c of the tool, slack within its length.

    ``pull`` is f₀: with L = 0 the force k(a − p) is linear in k and f₀ = k a, whatever the anchor.

    Seen in: many positions, also at like orientations: the pull follows position. A run with the
    cable unplugged settles it.
    """

    name = "cable.pull"
    title = "a cable or hose pulls on the tool"
    rough = True
    source = "0.2–3 N, engineering memory"

    def parameters(self, robot: Robot) -> ParameterSet:
        return ParameterSet(
            (
                Parameter("stiffness", 0.0, "N/m", 2.0, -1e4, 1e4, "of the cable"),
                *(Parameter(f"pull.{a}", 0.0, "N", 1.0, -200, 200, "at the base") for a in "xyz"),
                *(Parameter(f"anchor.{a}", 0.0, "m", 0.5, -5, 5, "in the world") for a in "xyz"),
                Parameter("length", 0.0, "m", 0.3, 0.0, 5.0, "at which it becomes taut"),
                *(
                    Parameter(n, 0.0, "m", 0.03, -1, 1, "where it holds, sensor axes")
                    for n in POINT
                ),
            )
        )

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        if not scene.jointed:
            return ()
        free = ("stiffness", "pull.x", "pull.y", "pull.z")
        held = dict(zip(POINT, map(float, scene.tool.cog), strict=True))
        taut = Variant("always taut", free, held, POINT, weight=4.0)
        shape = ("anchor.x", "anchor.y", "anchor.z", "length")
        position = value(scene.pose[1])[scene.held]
        middle = position.mean(axis=0)
        slack = []
        for x, y, z in product((-1.0, 0.0, 1.0), (-1.0, 0.0, 1.0), (0.0, 1.0)):
            direction = np.array([x, y, z])
            if not direction.any():
                continue
            for reach, taut_share in product(REACHES, (0.3, 0.7)):
                anchor = middle + reach * direction / float(np.linalg.norm(direction))
                far = np.linalg.norm(position - anchor, axis=1)
                length = float(np.quantile(far, taut_share))
                at = dict(zip(shape, (*map(float, anchor), length), strict=True)) | held
                slack.append(Variant("slack in part", ("stiffness",), at, (*shape, *POINT)))
        return (taut, *slack)

    def load(self, scene: Scene, pose: Pose, load: np.ndarray, p: Values) -> np.ndarray:
        rotation = np.swapaxes(value(pose.rotation), -1, -2)
        lever = np.array([p[n] for n in POINT])
        position = value(pose.position) + apply(value(pose.rotation), lever)
        to_anchor = np.array([p[f"anchor.{a}"] for a in "xyz"]) - position
        far = np.maximum(np.linalg.norm(to_anchor, axis=-1, keepdims=True), 1e-9)
        pull = np.array([p[f"pull.{a}"] for a in "xyz"])
        force = pull + p["stiffness"] * to_anchor * np.maximum(0.0, 1.0 - p["length"] / far)
        own = apply(rotation, force)
        return np.concatenate([own, cross(np.broadcast_to(lever, own.shape), own)], axis=-1)

    def edit_spec(self, spec: "mujoco.MjSpec", robot: Robot, theta: np.ndarray, p: Values) -> None:
        """A tendon to the anchor, and one to far away for the constant pull."""
        from wrenchbed.springs import cable, pull

        point = tuple(p[n] for n in POINT)
        anchor = [p[f"anchor.{a}"] for a in "xyz"]
        if p["stiffness"]:
            cable(spec, self.name, point, anchor, p["stiffness"], p["length"])
        pull(spec, self.name, point, np.array([p[f"pull.{a}"] for a in "xyz"]))


EFFECT = CablePull()
