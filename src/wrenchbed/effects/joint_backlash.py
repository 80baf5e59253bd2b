"""Effect ``joint.backlash``: joints have backlash."""

from dataclasses import replace

import numpy as np

from wrenchbed.effects.base import (
    JointEffect,
    MjSpec,
    Values,
    Variant,
    each_joint,
    joint_parameters,
    joint_variants,
    vector,
)
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.model_parameters import ParameterSet
from wrenchbed.robots.base import Robot

SIDES = ("load", "approach")
SOFT = 0.01
"""Torque of gravity at which a joint leaves the middle of its backlash [N·m; N on a slide]: small
against a link's weight, so that the gap is nearly a jump."""


class JointBacklash(JointEffect):
    """δq = (β/2) tanh(τ/τ₀) where gravity decides, −(β/2) sgn(q̇) where the last motion does.

    Amplitudes are half gaps β/2, τ is gravity's torque. A link that gravity loads lies on gravity's
    side; one that friction holds lags behind its motor. τ₀ is small: tanh is nearly the sign.

    Seen in: poses approached from both sides, and gravity's torque of both signs; where gravity
    holds one side, nothing shows.
    """

    name = "joint.backlash"
    title = "joints have backlash"
    title_of_joint = "joint {joint} has backlash"
    shown = "torque"
    form_error = 0.15
    size_error = 0.15
    source = "gap 0.01–0.1° in servos, ≤ 0.02° in strain wave gears: estimate"
    amplitude = "load"
    smooth = False

    def parameters(self, robot: Robot) -> ParameterSet:
        texts = ("half gap, side of gravity", "half gap, side of the last way")
        load, approach = (
            joint_parameters(robot, side, 2e-4, 2e-5, text, ("rad", "m"))
            for side, text in zip(SIDES, texts, strict=True)
        )
        return load + approach

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        return tuple(
            replace(v, label=f"{v.label}, side by {side}", detail={**v.detail, "side": side})
            for side in SIDES
            if scene.jointed
            for v in joint_variants(side, scene.robot)
        )

    def displace(self, scene: Scene, p: Values) -> np.ndarray:
        load, approach = (vector(p, each_joint(side, scene.robot)) for side in SIDES)
        lag = -approach * scene.coming
        return lag + load * np.tanh(scene.joint_torque / SOFT) if load.any() else lag

    def edit_spec(self, spec: MjSpec, robot: Robot, theta: np.ndarray, p: Values) -> None:
        """Add joints with backlash in series, some of which lag by friction."""
        from wrenchbed.simulation.springs import Spring, in_series

        for k, joint in enumerate(robot.joints, start=1):
            for side in SIDES:
                half = p[f"{side}.q{k}"]
                if half:
                    spring = Spring(SOFT / half, abs(half), lags=side == "approach")
                    in_series(spec, self.name, joint.name, spring)


EFFECT = JointBacklash()
