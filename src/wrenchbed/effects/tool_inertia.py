"""Effect ``tool.inertia``: the tool's inertia differs from what is stated."""

import numpy as np

from wrenchbed.effects.base import ModelEffect, Pose, Values, Variant, added
from wrenchbed.effects.scene import ACCELERATION, Scene
from wrenchbed.physics.model_parameters import Parameter, ParameterSet
from wrenchbed.robots.base import INERTIA_AXES, Robot

NAMES = tuple(f"inertia.{a}" for a in INERTIA_AXES)
SHARE = "share"


class ToolInertia(ModelEffect):
    """I → I + δI about the centre of gravity in sensor axes; no wrench at rest shows it.

    Where only orientations are known a simulator has weight alone. With an accelerometer the
    ``share`` of F = −m a, T = c × F − I ω̇ − ω × I ω is fitted too: 1 if the tool is as stated.

    Seen in: a motion that turns and accelerates the tool.
    """

    name = "tool.inertia"
    title = "the tool's inertia differs from what is stated"
    source = "20 % of a drawing's or a guess's: estimate"
    modes = ("dynamic",)
    also_at = ("load",)

    def parameters(self, robot: Robot) -> ParameterSet:
        known = robot.parameters.mapping(robot.parameters.nominal)
        items = [
            Parameter(n, 0.0, "kg·m²", max(0.2 * known[f"tool.{n}"], 3e-4), -10, 10, "added")
            for n in NAMES
        ]
        if not robot.joints:
            text = "of the inertial load that orientations do not determine"
            items.append(Parameter(SHARE, 0.0, "1", 1.0, -10, 10, text))
        return ParameterSet(tuple(items))

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        if ACCELERATION in scene.extra:
            return (Variant("the load's own inertial force", (SHARE,)),)
        if not scene.moving:
            return ()
        single = [Variant(n[-2:], (n,), detail={"axes": n[-2:]}) for n in NAMES]
        return (
            Variant("all six", NAMES, weight=3.0),
            Variant("moments about x, y and z", NAMES[:3], weight=2.0),
            *single,
        )

    def theta(self, robot: Robot, theta: np.ndarray, p: Values) -> np.ndarray:
        return added(robot, theta, {f"tool.{n}": p[n] for n in NAMES})

    def pull(self, scene: Scene, pose: Pose, load: np.ndarray, p: Values) -> np.ndarray:
        """``share`` in p of the tool's inertial load by measured accelerations (M, 6); else 0."""
        return p.get(SHARE, 0.0) * scene.inertial


EFFECT = ToolInertia()
