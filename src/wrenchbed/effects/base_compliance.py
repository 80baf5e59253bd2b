"""Effect ``base.compliance``: the base is compliant and tilts under the arm's weight."""

import numpy as np

from wrenchbed.effects.base import Effect, MjSpec, Pose, Values, Variant, alike
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.rotations import apply, exp, matrix
from wrenchbed.robots.base import Robot

NAMES = ("compliance", "compliance.x", "compliance.y")


class BaseCompliance(Effect):
    """R → Exp(α) R about the base's origin, α = C M: R the sensor's orientation, M weight's moment.

    M [N·m] of all that moves is taken about the base's origin; only its horizontal part tilts the
    base. C [rad/(N·m)] is ``compliance`` about x and y of the world, plus ``compliance.x`` about x
    and ``compliance.y`` about y. With ``compliance`` alone the base turns about M: α ∥ +M.

    Seen in: poses stretched out and drawn in, with joint 1 turned: the tilt follows reach times
    weight.
    """

    name = "base.compliance"
    title = "the base is compliant and tilts under the arm's weight"
    stage = "pose"
    size_error = 0.1
    source = "1e-6–1e-5 rad/(N·m) of pedestals and tables: estimate"
    numbers = (
        *alike(NAMES[:1], "rad/(N·m)", 1e-5, 0.01, "about every horizontal axis"),
        *alike(NAMES[1:], "rad/(N·m)", 1e-5, 0.01, "more about this axis"),
    )

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        if not scene.jointed:
            return ()
        return (
            Variant("alike about x and y", NAMES[:1], weight=2.0),
            Variant("about x", NAMES[1:2]),
            Variant("about y", NAMES[2:]),
            Variant("about x and y", NAMES[1:]),
        )

    def pose(self, scene: Scene, pose: Pose, p: Values) -> Pose:
        give = np.array([p[NAMES[0]] + p[n] for n in NAMES[1:]])
        angle = scene.in_motion(scene.base_moment[:, :2] * give)
        turn = exp(angle[..., 0], angle[..., 1], 0.0 * angle[..., 0])
        origin = scene.robot.base_origin(scene.theta)
        return Pose(turn @ pose.rotation, origin + apply(turn, pose.position - origin))

    def edit_spec(self, spec: MjSpec, robot: Robot, theta: np.ndarray, p: Values) -> None:
        """Add two sprung hinges at the base, about x and y of the world."""
        from wrenchbed.simulation.springs import Spring, hinge

        for axis, name, world in zip("xy", NAMES[1:], np.eye(3), strict=False):
            give = p[NAMES[0]] + p[name]
            if give:
                in_base = [*map(float, world @ matrix(spec.body("base").quat))]
                hinge(self.name, axis, spec.body("base"), in_base, Spring(1.0 / give))


EFFECT = BaseCompliance()
