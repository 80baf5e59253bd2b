"""The chain from joint values to readings with effects, in closed form.

`EffectChain` is the one place that walks the stages; diagnosis, twin and export use it. Effects are
named as by ``--effect`` (public): ``joint.compliance:joint=2,stiffness=1.4e4``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.effects.base import STAGES, STATED_NUMBERS, Effect, Pose, unknown_name
from wrenchbed.effects.scene import Scene, examples
from wrenchbed.errors import ParameterError
from wrenchbed.physics.taylor_jets import Value, value
from wrenchbed.physics.wrench import wrench
from wrenchbed.robots.base import Robot


@dataclass(frozen=True, eq=False)
class ActiveEffect:
    """An effect with values of all its parameters by name: what a chain applies."""

    effect: Effect
    values: Mapping[str, float]

    @classmethod
    def of(cls, robot: Robot, name: str, given: Mapping[str, Any]) -> "ActiveEffect":
        """Make an effect by name, with values ``given`` for some parameters, others nominal.

        Raises:
            NotFoundError, ParameterError: the effect or a parameter does not exist.
        """
        effect = registry.load("effects", name)
        return cls(effect, effect.values(robot, given))


def effects() -> dict[str, Effect]:
    """All effects by name, in order of the registry; cached."""
    return {name: registry.load("effects", name) for name in registry.names("effects")}


def stated_effects() -> tuple[str, ...]:
    """Names of the effects of a wrong bias, mass, CoG in a recording's metadata, in this order."""
    by_number = {e.stated: name for name, e in effects().items()}
    return tuple(by_number[number] for number in STATED_NUMBERS)


def respond(scene: Scene, active: Sequence[ActiveEffect] = ()) -> np.ndarray:
    """Mean readings (M, 6) [N, N·m] of every row of a scene with effects."""
    return EffectChain(active).respond(scene)


class EffectChain:
    """Applies effects: stages in the order of `STAGES`, effects of a stage in the order given."""

    def __init__(self, active: Sequence[ActiveEffect]) -> None:
        self._at: dict[str, list[ActiveEffect]] = {s: [] for s in STAGES}
        for a in active:
            for stage in a.effect.stages:
                self._at[stage].append(a)

    @property
    def stages(self) -> frozenset[str]:
        """Names of the stages at which effects of the chain act."""
        return frozenset(s for s, active in self._at.items() if active)

    def theta(self, robot: Robot, theta: np.ndarray) -> np.ndarray:
        """Robot's parameters ``theta`` (P,) as changed by the effects that act on them."""
        for a in self._at["model"]:
            theta = a.effect.theta(robot, theta, a.values)
        return theta

    def displacement(self, scene: Scene) -> Value:
        """Sum of all effects' joint displacements (M, J), a `Jet` in motion; 0 without effects."""
        total: Any = 0.0
        for a in self._at["joint"]:
            dq = a.effect.displace(scene, a.values)
            total = total + (scene.in_motion(dq) if a.effect.smooth else dq)
        return total

    def pose(self, scene: Scene, theta: np.ndarray) -> Pose:
        """Pose of the sensor with effects, on a robot with parameters (P,)."""
        shift = self.displacement(scene)
        changed, names = np.flatnonzero(theta != scene.theta), scene.robot.parameters.names
        same_place = all(names[k] in scene.robot.load for k in changed)
        if same_place and isinstance(shift, float):
            pose = Pose(*scene.pose)
        else:
            pose = Pose(*scene.robot.sensor_pose(scene.q + shift, theta))
        for a in self._at["pose"]:
            pose = a.effect.pose(scene, pose, a.values)
        return pose

    def turned_base(self, scene: Scene) -> np.ndarray | None:
        """Rotation (M, 3, 3) of the base in the world by effects on the base; None without such."""
        tilting = [a for a in self._at["pose"] if a.effect.subsystem == "base"]
        pose = Pose(np.tile(np.eye(3), (len(scene), 1, 1)), np.zeros((len(scene), 3)))
        for a in tilting:
            pose = a.effect.pose(scene, pose, a.values)
        return np.asarray(value(pose.rotation)) if tilting else None

    def pull(self, scene: Scene, pose: Pose, load: np.ndarray) -> np.ndarray | float:
        """Wrench (M, 6) [N, N·m] that all effects add to a load (M, 6) on the sensor; 0 without."""
        more: np.ndarray | float = 0.0
        for a in self._at["load"]:
            more = more + a.effect.pull(scene, pose, load, a.values)
        return more

    def sensed(self, torque: np.ndarray) -> np.ndarray:
        """Joint torques (M, J) [N·m, of slides N] as torque sensors with the effects read them."""
        for a in self._at["effort"]:
            torque = a.effect.sense(torque, a.values)
        return torque

    def read(self, scene: Scene, load: np.ndarray) -> np.ndarray:
        """Readings (M, 6) [N, N·m] of a load (M, 6), with those effects that act in the scene."""
        reading = load
        for a in (*self._at["reading"], *self._at["timing"]):
            if a.effect.acts(scene):
                reading = a.effect.read(scene, reading, a.values)
        return reading

    def placed(self, scene: Scene) -> tuple[Pose, np.ndarray]:
        """Sensor's pose and the rigid tool's load on it (M, 6) [N, N·m], with effects on the
        robot's parameters, joints and pose, before effects add wrenches."""
        theta = self.theta(scene.robot, scene.theta)
        pose = self.pose(scene, theta)
        as_stated = pose.rotation is scene.pose[0] and pose.position is scene.pose[1]
        if theta is scene.theta and as_stated:
            return pose, scene.load
        tool = scene.robot.tool(theta)
        return pose, wrench(pose.rotation, pose.position, tool, scene.gravity)

    def respond(self, scene: Scene) -> np.ndarray:
        """Mean readings (M, 6) [N, N·m] of every row with all effects of the chain."""
        pose, load = self.placed(scene)
        return self.read(scene, load + self.pull(scene, pose, load))


def parse_effect(text: str) -> tuple[str, dict[str, Any]]:
    """Split ``name[:key=value,…]`` into the name and the values, as numbers where possible.

    Raises:
        ParameterError: a part without ``=``, or a key given twice.
    """
    name, _, remaining = text.strip().partition(":")
    values: dict[str, Any] = {}
    for part in filter(None, (p.strip() for p in remaining.split(","))):
        key, equals, value = (x.strip() for x in part.partition("="))
        if not equals or not key or not value:
            raise ParameterError(f"--effect {text}: {part!r} is not name=value")
        if key in values:
            raise ParameterError(f"--effect {text}: {key!r} is given twice")
        try:
            values[key] = float(value)
        except ValueError:
            values[key] = value
    return name, values


def active_effect(robot: Robot, text: str) -> ActiveEffect:
    """Make an effect from text as ``joint.offset:joint=3``. Without amplitudes these have typical
    sizes, in the variant (joint, channel …) that the text selects, else in the commonest.

    Raises:
        NotFoundError, ParameterError: no such effect or parameter, or an impossible value.
    """
    name, given = parse_effect(text)
    effect = registry.load("effects", name)
    variants = [v for scene in examples(robot) for v in effect.variants(scene)]
    meant = [v for v in variants if given.items() <= v.detail.items()]
    known = effect.parameters(robot)
    if meant:
        variant = max(meant, key=lambda v: v.weight)
        size = dict(variant.at)
        size |= {n: known[known.index(n)].tolerance for n in effect.usual(variant)}
        return ActiveEffect.of(robot, name, size)
    if given:
        taken = (*(n for v in variants for n in v.detail), *effect.taken(robot))
        for unknown in (n for n in given if n not in taken):
            raise unknown_name(name, unknown, tuple(dict.fromkeys(taken)), len(robot.joints))
        return ActiveEffect.of(robot, name, given)
    return ActiveEffect.of(robot, name, {p.name: p.tolerance for p in known if p.nominal == 0.0})
