"""Effect ``mount.rotation``: the sensor is rotated on its flange."""

import numpy as np

from wrenchbed.effects.base import ModelEffect, Values, Variant, alike, vector
from wrenchbed.effects.scene import Scene
from wrenchbed.robots.base import Robot, rotate_sensor

TYPICAL = np.deg2rad(0.5)
NAMES = tuple(f"rotation.{a}" for a in "xyz")


class MountRotation(ModelEffect):
    """R_world_sensor → R_world_sensor Exp(ω), ω a rotation vector; the tool turns with the sensor.

    Seen in: varied orientations.
    """

    name = "mount.rotation"
    title = "the sensor is rotated on its flange"
    source = "0.2–1° of bolt holes and dowels: estimate"
    numbers = alike(NAMES, "rad", TYPICAL, 3.2, "rotation vector in sensor axes")

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        return (
            Variant("about x, y and z", NAMES),
            Variant("about z", NAMES[2:]),
            Variant("about x and y", NAMES[:2]),
        )

    def theta(self, robot: Robot, theta: np.ndarray, p: Values) -> np.ndarray:
        return rotate_sensor(robot, theta, vector(p, NAMES))


EFFECT = MountRotation()
