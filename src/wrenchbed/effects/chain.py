"""The chain from joint values to readings with effects, in closed form.

`EffectChain` is the one place that walks the stages; a diagnosis, a twin and an export use it.
Effects are named here as on the command line: ``joint.compliance:joint=2,stiffness=1.4e4``.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from wrenchbed import registry
from wrenchbed.effects.base import (
    STAGES,
    STATED_NUMBERS,
    Effect,
    Pose,
    Values,
    Variant,
    unknown_name,
)
from wrenchbed.effects.scene import Scene, examples
from wrenchbed.errors import ParameterError
from wrenchbed.physics.parameters import Parameter
from wrenchbed.physics.time_derivatives import Jet, Value
from wrenchbed.physics.wrench import CHANNELS, wrench
from wrenchbed.robots.base import Robot

_T = TypeVar("_T")
_KEPT = 4
"""Results that `Responses` keeps: those of a fit's place and of steps from it; estimate."""
_Key = tuple[tuple[Any, ...], ...]
_PLACING = frozenset(("model", "joint", "pose"))
"""Stages that decide where the sensor is and what it carries."""
_STEP = 1e-4
"""Step of central differences by joint values [rad or m], rates and accelerations; estimate."""


@dataclass(frozen=True, eq=False)
class ActiveEffect:
    """An effect with values of all its parameters."""

    effect: Effect
    values: Mapping[str, float]

    @classmethod
    def of(cls, robot: Robot, name: str, given: Mapping[str, Any]) -> "ActiveEffect":
        """Effect by its registry name; parameters not given are nominal.

        Raises:
            NotFoundError, ParameterError: the effect or a parameter does not exist.
        """
        effect = registry.load("effects", name)
        return cls(effect, effect.values(robot, given))


def effects() -> dict[str, Effect]:
    """All effects by name, in the registry's order."""
    return {name: registry.load("effects", name) for name in registry.names("effects")}


def stated_effects() -> tuple[str, ...]:
    """Names of the effects that are a wrong bias, mass and CoG, in this order."""
    by_number = {e.stated: name for name, e in effects().items()}
    return tuple(by_number[number] for number in STATED_NUMBERS)


def respond(scene: Scene, active: Sequence[ActiveEffect] = ()) -> np.ndarray:
    """Mean readings (M, 6) [N, N·m] of every row of a scene with effects acting."""
    return EffectChain(active).respond(scene)


class EffectChain:
    """Walks the stages: effects of a stage act in the order given, stages in that of `STAGES`."""

    def __init__(self, active: Sequence[ActiveEffect]) -> None:
        self._at: dict[str, list[ActiveEffect]] = {s: [] for s in STAGES}
        for a in active:
            for stage in a.effect.stages:
                self._at[stage].append(a)

    def theta(self, robot: Robot, theta: np.ndarray) -> np.ndarray:
        """The robot's parameters (P,) with the effects of the stage ``model``."""
        for a in self._at["model"]:
            theta = a.effect.theta(robot, theta, a.values)
        return theta

    def displacement(self, scene: Scene) -> Value:
        """Displacement of the joint values (M, J) by all effects, with derivatives in a motion; 0
        if none."""
        total: Any = 0.0
        for a in self._at["joint"]:
            dq = a.effect.displace(scene, a.values)
            total = total + (scene.in_motion(dq) if a.effect.smooth else dq)
        return total

    def pose(self, scene: Scene, theta: np.ndarray) -> Pose:
        """Pose of the sensor on a robot with parameters (P,)."""
        shift = self.displacement(scene)
        same_place = theta is scene.theta or _only_load(scene, theta)
        if same_place and isinstance(shift, float):
            pose = Pose(*scene.pose)
        else:
            pose = Pose(*scene.robot.sensor_pose(scene.q + shift, theta))
        for a in self._at["pose"]:
            pose = a.effect.pose(scene, pose, a.values)
        return pose

    def pull(self, scene: Scene, pose: Pose, load: np.ndarray) -> np.ndarray | float:
        """Wrench that effects add to a load on the sensor (M, 6) [N, N·m]; 0 if none."""
        more: np.ndarray | float = 0.0
        for a in self._at["load"]:
            more = more + a.effect.pull(scene, pose, load, a.values)
        return more

    def read(self, scene: Scene, load: np.ndarray) -> np.ndarray:
        """Reading of the sensor for a load (M, 6) [N, N·m]; no delay shows at rest."""
        reading = load
        for a in (*self._at["reading"], *self._at["timing"]):
            if a.effect.acts(scene):
                reading = a.effect.read(scene, reading, a.values)
        return reading

    def placed(self, scene: Scene) -> tuple[Pose, np.ndarray]:
        """Pose of the sensor, and the tool's load on it (M, 6) [N, N·m], after stages ``model``,
        ``joint`` and ``pose``; no effect has added a wrench yet."""
        theta = self.theta(scene.robot, scene.theta)
        pose = self.pose(scene, theta)
        as_stated = pose.rotation is scene.pose[0] and pose.position is scene.pose[1]
        if theta is scene.theta and as_stated:
            return pose, scene.load
        tool = scene.robot.tool(theta)
        return pose, wrench(pose.rotation, pose.position, tool, scene.gravity)

    def respond(self, scene: Scene) -> np.ndarray:
        """Mean readings (M, 6) [N, N·m] of every row after all stages."""
        pose, load = self.placed(scene)
        return self.read(scene, load + self.pull(scene, pose, load))

    def late_response(self, scene: Scene, nominal: np.ndarray) -> np.ndarray:
        """Readings (M, 6) up to a constant, from the first stage at which an effect acts; nominal
        are those without effects (M, 6)."""
        stages = {s for s, active in self._at.items() if active}
        if stages <= {"reading", "timing"}:
            return self.read(scene, nominal)
        if stages == {"load"}:
            return np.asarray(self.pull(scene, Pose(*scene.pose), scene.load))
        return self.respond(scene)


class Responses:
    """Readings of one scene with many sets of effects, as `respond` makes them.

    A fit changes one number after the other: what the stages up to the pose make is kept while the
    effects that act there stay as they are, and readings are kept while all do.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._placed: dict[_Key, tuple[Pose, np.ndarray]] = {}
        self._readings: dict[_Key, np.ndarray] = {}

    def of(self, active: Sequence[ActiveEffect]) -> np.ndarray:
        """Mean readings (M, 6) [N, N·m] of every row with effects acting; not to be changed."""
        return _kept(self._readings, _key(active), lambda: self._made(active))

    def _made(self, active: Sequence[ActiveEffect]) -> np.ndarray:
        chain = EffectChain(active)
        early = [a for a in active if not _PLACING.isdisjoint(a.effect.stages)]
        pose, load = _kept(self._placed, _key(early), lambda: chain.placed(self.scene))
        return chain.read(self.scene, load + chain.pull(self.scene, pose, load))


def _key(active: Sequence[ActiveEffect]) -> _Key:
    return tuple((a.effect.name, *a.values.items()) for a in active)


def _kept(known: dict[_Key, _T], key: _Key, make: Callable[[], _T]) -> _T:
    """Cached value of a key, or a newly made one; the least recently used is dropped first."""
    value = known.pop(key) if key in known else make()
    if len(known) == _KEPT:
        del known[next(iter(known))]
    known[key] = value
    return value


@dataclass(frozen=True, eq=False)
class Response:
    """Readings (M, 6) of a scene, and how they change with one amplitude of one effect."""

    scene: Scene
    reading: np.ndarray

    def tangent(self, effect: Effect, parameter: Parameter, variant: Variant) -> np.ndarray:
        """Change of all readings (M, 6) per typical size, by central differences."""
        ((_, change),) = self.changes(effect, [parameter], variant.at)
        return change

    def changes(
        self, effect: Effect, parameters: Sequence[Parameter], at: Values
    ) -> Iterator[tuple[tuple[str, ...], np.ndarray]]:
        """`tangent` of several amplitudes of one shape: their names and the changes (M, 6).

        Amplitudes that act on different channels, or on different joints, are changed at once:
        where there are several names, each change is that of its own channel.
        """
        names_of_joints = [f"q{k + 1}" for k in range(self.scene.joints.shape[1])]
        groups: dict[str, list[Parameter]] = {}
        for p in parameters:
            stem, _, end = p.name.rpartition(".")
            by_channel = effect.channelwise and end in CHANNELS
            by_joint = effect.stages == ("joint",) and effect.local and end in names_of_joints
            groups.setdefault(f"{stem}." if by_channel or by_joint else p.name, []).append(p)
        for group in groups.values():
            names = tuple(p.name for p in group)
            up, down = self._about(effect, at, group)
            if effect.stages != ("joint",):
                high = up.late_response(self.scene, self.reading)
                yield names, high - down.late_response(self.scene, self.reading)
                continue
            shift = up.displacement(self.scene) - down.displacement(self.scene)
            change = {n: self._by_joint(shift, j) for j, n in enumerate(names_of_joints)}
            if len(group) > 1:
                yield from (((n,), change[n.rpartition(".")[2]]) for n in names)
            else:
                yield names, np.asarray(sum(change.values(), np.zeros(6)))

    def _about(
        self, effect: Effect, at: Values, parameters: Sequence[Parameter]
    ) -> tuple[EffectChain, EffectChain]:
        """Copies of an effect with amplitudes half their typical size above and below zero."""
        start = {p.name: p.nominal for p in effect.parameters(self.scene.robot)} | dict(at)
        steps = ({p.name: s * p.tolerance for p in parameters} for s in (0.5, -0.5))
        up, down = (EffectChain([ActiveEffect(effect, start | step)]) for step in steps)
        return up, down

    def _by_joint(self, shift: Value, joint: int) -> np.ndarray:
        """Change of all readings (M, 6) by one joint's small shift, of those of all (M, J)."""
        given = (shift.v, shift.d, shift.dd) if isinstance(shift, Jet) else (shift,)
        total = np.zeros((len(self.scene), 6))
        for slopes, x in zip(self._slopes, given, strict=False):
            total += slopes[joint] * x[:, joint, None]
        return total

    @cached_property
    def _slopes(self) -> tuple[np.ndarray, ...]:
        """Slopes of the readings (J, M, 6) by joint values, in motion by their rates and
        accelerations too."""
        scene, orders = self.scene, 3 if self.scene.moving else 1
        tool = scene.robot.tool(scene.theta)

        def load(order: int, shift: np.ndarray) -> np.ndarray:
            parts = [shift if k == order else np.zeros_like(shift) for k in range(orders)]
            q = scene.q + (Jet(*parts) if scene.moving else shift)
            return wrench(*scene.robot.sensor_pose(q, scene.theta), tool, scene.gravity)

        steps = _STEP * np.eye(scene.joints.shape[1])[:, None, :] * np.ones((len(scene), 1))
        return tuple(
            np.stack([(load(k, s) - load(k, -s)) / (2.0 * _STEP) for s in steps])
            for k in range(orders)
        )


def _only_load(scene: Scene, theta: np.ndarray) -> bool:
    changed = np.flatnonzero(theta != scene.theta)
    names = scene.robot.parameters.names
    return all(names[k] in scene.robot.load for k in changed)


def parse_effect(text: str) -> tuple[str, dict[str, Any]]:
    """``name[:key=value,…]`` → the name and the values, numbers where they are numbers.

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
    """An effect by its text. Without amplitudes it has its typical size, in the variant that the
    values given single out (``joint.offset:joint=3``), else in the commonest.

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
