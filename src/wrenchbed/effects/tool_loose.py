"""A part of the tool is loose and falls to one side or the other."""

from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from wrenchbed.effects.base import LoadEffect, Pose, Values, Variant
from wrenchbed.frames import cross
from wrenchbed.parameters import Parameter, ParameterSet
from wrenchbed.robots.base import Robot
from wrenchbed.scene import Scene, held_on

if TYPE_CHECKING:
    import mujoco

WAY = ("way.x", "way.y", "way.z")
SOFT = 0.05
"""Share of the load along the way at which the part leaves the middle; small: nearly a jump."""
GRIP = 0.3
"""Share of the load along the way below which a part that sticks stays where it was."""


class ToolLoose(LoadEffect):
    """c → c + s n sgn(n·F/|F| − l): the centre of gravity jumps along a way n, torque δc × F.

    The sign is tanh(…/0.05), l leans to one side; with a ``grip`` it turns only once n·F/|F| is
    that far beyond l. What flows along the load has no torque; along one axis it is tool.flexure.
    """

    name = "tool.loose"
    title = "a part of the tool is loose and falls to one side or the other"
    rough = True
    form_error = 0.2
    source = "CoG jumps of 0.5–5 mm: engineering memory"

    def parameters(self, robot: Robot) -> ParameterSet:
        return ParameterSet(
            (
                Parameter("shift", 0.0, "m", 1e-3, -1.0, 1.0, "half the jump of the tool's CoG"),
                *(Parameter(w, float(w == WAY[2]), "1", 0.1, -2, 2, "of the jump") for w in WAY),
                Parameter("lean", 0.0, "1", 0.05, -0.9, 0.9, "share of the load at which it jumps"),
                Parameter("grip", 0.0, "1", 0.1, 0.0, 0.9, "share of the load that moves it"),
            )
        )

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        result = []
        for way in product((-1.0, 0.0, 1.0), repeat=3):
            if way > (0.0, 0.0, 0.0):  # one of each two opposite ways
                along = np.array(way) / np.linalg.norm(way)
                at = dict(zip(WAY, map(float, along), strict=True)) | {"lean": 0.0}
                label = "".join(f"{w:+.0f}{a}" for a, w in zip("xyz", way, strict=True) if w)
                for grip, text in ((0.0, "falls"), (GRIP, "sticks")):
                    begin = at | {"grip": grip}
                    shape = (*WAY, "lean") if not grip else (*WAY, "lean", "grip")
                    result.append(Variant(f"{text} along {label}", ("shift",), begin, shape))
        return tuple(result)

    def load(self, scene: Scene, pose: Pose, load: np.ndarray, p: Values) -> np.ndarray:
        tool = scene.tool
        force = load[:, :3] * (tool.mass / (tool.mass + tool.sensor_mass))
        towards = force / np.maximum(np.linalg.norm(force, axis=1, keepdims=True), 1e-9)
        way = direction(p)
        lever = p["shift"] * _side(towards @ way - p["lean"], p["grip"])[:, None] * way
        return np.concatenate([np.zeros_like(force), cross(lever, force)], axis=1)

    def edit_spec(self, spec: "mujoco.MjSpec", robot: Robot, theta: np.ndarray, p: Values) -> None:
        """The tool's mass slides with play; what leans to one side stays closed form."""
        from wrenchbed.springs import slide

        weight = float(robot.tool(theta).mass) * float(np.linalg.norm(spec.option.gravity))
        half = p["shift"]
        if half:
            way, soft = [*map(float, direction(p))], SOFT * weight / half
            grip, lean = p["grip"] * weight, -p["lean"] * weight
            slide(spec, self.name, "shift", way, soft, abs(half), grip, lean)


def direction(p: Values) -> np.ndarray:
    """n (3,)."""
    way = np.array([p[w] for w in WAY])
    return way / max(float(np.linalg.norm(way)), 1e-9)


def _side(along: np.ndarray, grip: float) -> np.ndarray:
    """End of its way at which a part lies (M,): −1 … 1."""
    if not grip:
        return np.tanh(along / SOFT)
    return held_on(np.where(np.abs(along) > grip, np.sign(along), 0.0)[:, None])[:, 0]


EFFECT = ToolLoose()
