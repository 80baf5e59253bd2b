"""From joint values to readings, with effects, in closed form: what a diagnosis fits with."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.effects.base import (
    Effect,
    JointEffect,
    LoadEffect,
    ModelEffect,
    Pose,
    PoseEffect,
    ReadingEffect,
)
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.taylor import Value
from wrenchbed.physics.wrench import wrench
from wrenchbed.robots.base import Robot


@dataclass(frozen=True, eq=False)
class ActiveEffect:
    """An effect with values of all its parameters."""

    effect: Effect
    values: Mapping[str, float]

    @classmethod
    def of(cls, robot: Robot, name: str, given: Mapping[str, Any]) -> "ActiveEffect":
        """By registry name; parameters not given are nominal.

        Raises:
            NotFoundError, ParameterError: the effect or a parameter does not exist.
        """
        effect = registry.load("effects", name)
        return cls(effect, effect.values(robot, given))

    def __getitem__(self, name: str) -> float:
        return self.values[name]


def effects() -> dict[str, Effect]:
    """All effects by name, in the registry's order."""
    return {name: registry.load("effects", name) for name in registry.names("effects")}


def acts(effect: Effect, scene: Scene) -> bool:
    """Whether an effect can show in such a scene: measured accelerations show a motion's too."""
    return ("dynamic" if scene.moving else "static") in effect.modes or bool(scene.extra)


def respond(scene: Scene, active: Sequence[ActiveEffect] = ()) -> np.ndarray:
    """Mean readings (M, 6) [N, N·m] of every row of a scene with effects acting.

    Effects of a stage act in the order given; stages in the order of the chain.
    """
    theta = with_model_effects(scene, active)
    pose = _pose(scene, active, theta)
    if theta is scene.theta and pose.rotation is scene.pose[0] and pose.position is scene.pose[1]:
        load = scene.load
    else:
        load = wrench(pose.rotation, pose.position, scene.robot.tool(theta), scene.gravity)
    return _read(scene, active, load + _more_load(scene, active, pose, load))


def with_model_effects(scene: Scene, active: Sequence[ActiveEffect]) -> np.ndarray:
    """The robot's parameters (P,) with the effects of the stage ``model``."""
    theta = scene.theta
    for a in active:
        if isinstance(a.effect, ModelEffect):
            theta = a.effect.theta(scene.robot, theta, a.values)
    return theta


def displacement(scene: Scene, active: Sequence[ActiveEffect]) -> Value:
    """What effects add to the joint values (M, J), with derivatives in a motion; 0 without any."""
    total: Any = 0.0
    for a in active:
        if isinstance(a.effect, JointEffect):
            dq = a.effect.displace(scene, a.values)
            total = total + (scene.in_motion(dq) if a.effect.smooth else dq)
    return total


def _pose(scene: Scene, active: Sequence[ActiveEffect], theta: np.ndarray) -> Pose:
    shift = displacement(scene, active)
    same_place = theta is scene.theta or _only_load(scene, theta)
    if same_place and isinstance(shift, float):
        pose = Pose(*scene.pose)
    else:
        pose = Pose(*scene.robot.sensor_pose(scene.q + shift, theta))
    for a in active:
        if isinstance(a.effect, PoseEffect):
            pose = a.effect.pose(scene, pose, a.values)
    return pose


def _only_load(scene: Scene, theta: np.ndarray) -> bool:
    changed = np.flatnonzero(theta != scene.theta)
    names = scene.robot.parameters.names
    return all(names[k] in scene.robot.load for k in changed)


def _more_load(
    scene: Scene, active: Sequence[ActiveEffect], pose: Pose, load: np.ndarray
) -> np.ndarray | float:
    more: np.ndarray | float = 0.0
    for a in active:
        if isinstance(a.effect, LoadEffect):
            more = more + a.effect.load(scene, pose, load, a.values)
    return more


def _read(scene: Scene, active: Sequence[ActiveEffect], reading: np.ndarray) -> np.ndarray:
    for stage in ("reading", "timing"):
        for a in active:
            if isinstance(a.effect, ReadingEffect) and a.effect.stage == stage:
                reading = a.effect.read(scene, reading, a.values)
    return reading
