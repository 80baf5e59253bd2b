"""Effect ``cable.torsion``: a cable or hose is twisted by the last joint."""

import numpy as np

from wrenchbed.effects.base import LoadEffect, Pose, Values, Variant, alike
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.model_parameters import Parameter
from wrenchbed.physics.taylor_jets import STEP


class CableTorsion(LoadEffect):
    """T −= a (k (q − q₀) + f sgn(q̇)): T loads the sensor, q is the last joint, q̇ its last motion.

    k is the cable's stiffness, f its friction. a is the sensor's z, or with ``joint_axis`` = 1 the
    last joint's axis in sensor axes; on the UR5 both are one. k q₀ is a constant: a bias.

    Seen in: the last joint turned far and both ways.
    """

    name = "cable.torsion"
    title = "a cable or hose is twisted by the last joint"
    form_error = 0.1
    size_error = 0.1
    zero_is_convention = True
    source = "5–50 mN·m a turn and as much friction: estimate"
    numbers = (
        *alike(("stiffness",), "N·m/rad", 5e-3, 10.0, "of the cable"),
        *alike(("friction",), "N·m", 5e-3, 10.0, "half the width of its loop"),
        *alike(("neutral",), "rad", 1.0, 20.0, "untwisted here"),
        Parameter("joint_axis", 0.0, "1", 1.0, 0.0, 1.0, "1: about the joint, 0: about z"),
    )

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        if not scene.jointed or scene.robot.joints[-1].unit != "rad":
            return ()
        families = {"": 0.0}
        if float(joint_axis(scene)[:, 2].min()) < 0.999:
            families[" about the last joint"] = 1.0
        return tuple(
            Variant(label + where, free, {"joint_axis": about, "neutral": 0.0}, ("neutral",))
            for where, about in families.items()
            for label, free in (
                ("twists", ("stiffness",)),
                ("rubs", ("friction",)),
                ("twists and rubs", ("stiffness", "friction")),
            )
        )

    def pull(self, scene: Scene, pose: Pose, load: np.ndarray, p: Values) -> np.ndarray:
        twist = p["stiffness"] * (scene.joints[:, -1] - p["neutral"])
        twist = twist + p["friction"] * scene.coming[:, -1]
        axis = joint_axis(scene) if p["joint_axis"] > 0.5 else np.array([0.0, 0.0, 1.0])
        return np.concatenate([np.zeros((len(scene), 3)), -axis * twist[:, None]], axis=1)


def joint_axis(scene: Scene) -> np.ndarray:
    """Axis about which the last joint turns the sensor, unit vectors (M, 3) in sensor axes."""
    q = scene.joints.astype(complex)
    q[:, -1] += 1j * STEP
    rotation, _ = scene.robot.sensor_pose(q, scene.theta)
    spin = np.swapaxes(rotation.real, -1, -2) @ (rotation.imag / STEP)
    axis = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=-1)
    return np.asarray(axis / np.linalg.norm(axis, axis=-1, keepdims=True))


EFFECT = CableTorsion()
