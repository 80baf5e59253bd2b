"""The tool's tip touches something."""

from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from wrenchbed.effects.base import LoadEffect, Pose, Values, Variant
from wrenchbed.errors import NotFoundError
from wrenchbed.frames import apply, cross
from wrenchbed.jets import value
from wrenchbed.parameters import Parameter, ParameterSet
from wrenchbed.robots.base import Robot
from wrenchbed.scene import Scene

if TYPE_CHECKING:
    import mujoco

LENGTH = 0.01
SHARES = (0.05, 0.15, 0.35)
"""Of the rows, that touch where a search begins."""
NORMAL = ("normal.x", "normal.y", "normal.z")


class EnvironmentContact(LoadEffect):
    """F = k l (x/l)₊ⁿ n, x = d − n·p, at the tip p: a plane with the normal n pushes back.

    l = 1 cm, and n = 1 of a spring, 3/2 of a ball on a half space (Hertz); no friction.

    The tip is that of the robot's model, else twice as far from the sensor as the CoG.

    Seen in: poses inside and outside the region that is touched; it acts on one side only.
    """

    name = "environment.contact"
    title = "the tool's tip touches something"
    rough = True
    form_error = 0.2
    source = "skin, gel and foam 100–2000 N/m: engineering memory"

    def parameters(self, robot: Robot) -> ParameterSet:
        return ParameterSet(
            (
                Parameter("stiffness", 0.0, "N/m", 500.0, -1e6, 1e6, "of what is touched"),
                Parameter("reach", 1.0, "1", 0.2, 0.1, 5.0, "of what touches, over the tip's"),
                Parameter("power", 1.0, "1", 0.2, 0.3, 4.0, "of the depth"),
                Parameter("depth", 0.0, "m", 0.02, -10, 10, "of the plane: n·p = d"),
                *(
                    Parameter(n, float(n[-1] == "z"), "1", 0.1, -2, 2, "out of the plane, world")
                    for n in NORMAL
                ),
            )
        )

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        if not scene.jointed:
            return ()
        rotation, position = scene.pose
        at = (value(position) + apply(value(rotation), tip(scene)))[scene.held]
        result = []
        for way in (w for w in product((-1.0, 0.0, 1.0), repeat=3) if any(w)):
            normal = np.array(way) / np.linalg.norm(way)
            label = "".join(
                f"{'+' if w > 0 else '−'}{a}" for a, w in zip("xyz", way, strict=True) if w
            )
            for share in SHARES:
                depth = float(np.quantile(at @ normal, share))
                begin = dict(zip(NORMAL, map(float, normal), strict=True)) | {"depth": depth}
                begin |= {"power": 1.0, "reach": 1.0}
                shape = ("depth", *NORMAL, "power", "reach")
                text = f"from {label}, {share:.0%} of rows"
                result.append(Variant(text, ("stiffness",), begin, shape, {"side": label}))
        return tuple(result)

    def load(self, scene: Scene, pose: Pose, load: np.ndarray, p: Values) -> np.ndarray:
        normal = np.array([p[n] for n in NORMAL])
        normal = normal / max(float(np.linalg.norm(normal)), 1e-9)
        rotation, lever = value(pose.rotation), p["reach"] * tip(scene)
        at = value(pose.position) + apply(rotation, lever)
        push = p["stiffness"] * pressed(p["depth"] - at @ normal, p["power"])
        force = push[:, None] * (np.swapaxes(rotation, -1, -2) @ normal)
        return np.concatenate([force, cross(np.broadcast_to(lever, force.shape), force)], axis=1)

    def edit_spec(self, spec: "mujoco.MjSpec", robot: Robot, theta: np.ndarray, p: Values) -> None:
        """A plane that pushes the tip back like a spring; other powers stay closed form."""
        from wrenchbed.springs import plane

        if p["stiffness"] and p["power"] == 1.0:
            q = robot.sample(1, np.random.default_rng(0))
            still = Scene(robot, theta, np.zeros(3), q, np.zeros(1), np.ones(1, dtype=bool))
            normal = np.array([p[n] for n in NORMAL])
            normal = normal / max(float(np.linalg.norm(normal)), 1e-9)
            point = [float(x) for x in p["reach"] * tip(still)]
            plane(spec, self.name, point, normal, p["depth"], p["stiffness"])


def pressed(x: np.ndarray, power: float) -> np.ndarray:
    """l (x/l)₊ⁿ of depths (M,) [m]."""
    return np.asarray(LENGTH * (np.maximum(0.0, x) / LENGTH) ** power)


def tip(scene: Scene) -> np.ndarray:
    """The tool's tip in sensor axes from the sensor's origin (3,) [m]."""
    q, theta = scene.joints[:1], scene.theta
    try:
        _, end = scene.robot.tool_pose(q, theta)
    except NotFoundError:
        return 2.0 * scene.tool.cog
    rotation, origin = scene.robot.sensor_pose(q, theta)
    return np.asarray(rotation[0].T @ (end[0] - origin[0]))


EFFECT = EnvironmentContact()
