"""Effect ``joint.compliance``: joints are compliant and deflect under gravity."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from wrenchbed.effects.base import (
    JointEffect,
    MjSpec,
    Published,
    Values,
    Variant,
    each_joint,
    of_joint,
    vector,
)
from wrenchbed.effects.scene import Scene
from wrenchbed.errors import ParameterError
from wrenchbed.robots.base import Robot


class JointCompliance(JointEffect):
    """δq = τ/k with the torque τ of gravity; amplitudes are compliances 1/k.

    Seen in: gravity's torque of both signs, and a second payload, which distinguishes it from a
    gear error.
    """

    name = "joint.compliance"
    title = "joints are compliant and deflect under gravity"
    title_of_joint = "joint {joint} is compliant and deflects under gravity"
    shown = "torque"
    size_error = 0.1
    source = "UR 1–3e4 N·m/rad, wrists 3–8e3: estimate; drives 1e5–1e6 N/m"
    amplitude, sizes, text = "compliance", (7e-5, 3e-6), "compliance of a joint, 1/k"
    units = ("rad/(N·m)", "m/N")

    def displace(self, scene: Scene, p: Values) -> np.ndarray:
        give = vector(p, each_joint("compliance", scene.robot))
        return scene.joint_torque * give

    def taken(self, robot: Robot) -> tuple[str, ...]:
        names = self.parameters(robot).names
        return ("joint", "stiffness", *names, *each_joint("stiffness", robot))

    def values(self, robot: Robot, given: Mapping[str, Any]) -> dict[str, float]:
        """All parameters by name; also takes ``joint=2,stiffness=1.4e4`` [N·m/rad]."""
        remaining = of_joint(given, self.taken(robot), len(robot.joints))
        for name in [n for n in remaining if n.startswith("stiffness.")]:
            stiffness = remaining.pop(name)
            if not isinstance(stiffness, int | float) or not stiffness > 0:
                raise ParameterError(f"{self.name}: {name} = {stiffness} must be above 0 N·m/rad")
            remaining[name.replace("stiffness", "compliance")] = 1.0 / stiffness
        return super().values(robot, remaining)

    def publish(self, robot: Robot, variant: Variant, values: Values, std: Values) -> Published:
        """Parameters to publish: of a single joint its stiffness, of several joints compliances."""
        result = super().publish(robot, variant, values, std)
        if len(variant.free) != 1:
            return result
        name = variant.free[0]
        turns = robot.joints[int(variant.detail["joint"]) - 1].unit == "rad"
        give, unsure = values[name], std.get(name)
        stiffness = {
            "value": 1.0 / give if give else float("inf"),
            "std": None if unsure is None or not give else unsure / give**2,
            "unit": "N·m/rad" if turns else "N/m",
        }
        return {"stiffness": stiffness} | {k: v for k, v in result.items() if k != name}

    def amplitudes(
        self, published: Mapping[str, Mapping[str, Any]]
    ) -> dict[str, Mapping[str, Any]] | None:
        """Inverse of `publish`: a stiffness k ± σ as its joint's compliance 1/k ± σ/k²."""
        if "stiffness" not in published:
            return dict(published)
        k, std = published["stiffness"]["value"], published["stiffness"]["std"]
        if "joint" not in published or k == 0.0:
            return None
        give = {"value": 1.0 / k, "std": None if std is None else std / k**2}
        return {f"compliance.q{published['joint']['value']}": give}

    def edit_spec(self, spec: MjSpec, robot: Robot, theta: np.ndarray, p: Values) -> None:
        """Add a torsional spring in series with each joint."""
        from wrenchbed.simulation.springs import Spring, in_series

        for k, joint in enumerate(robot.joints, start=1):
            give = p[f"compliance.q{k}"]
            if give:
                in_series(spec, self.name, joint.name, Spring(1.0 / give))


EFFECT = JointCompliance()
