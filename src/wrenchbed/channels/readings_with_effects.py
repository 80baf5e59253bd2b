"""Readings of all channels of a recording under effects, and their change with one effect.

Readings (M, C) of M rows hold the columns of one channel after the other, the wrench's first.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np

from wrenchbed.channels.base import PLACING, Channel
from wrenchbed.effects.base import Effect, Pose, Values, Variant
from wrenchbed.effects.chain import ActiveEffect, EffectChain
from wrenchbed.effects.scene import Scene
from wrenchbed.errors import ParameterError
from wrenchbed.physics.model_parameters import Parameter
from wrenchbed.physics.taylor_jets import Jet, Value
from wrenchbed.physics.wrench import CHANNELS

_T = TypeVar("_T")
_KEPT = 4
"""Results that `Responses` keeps: of a fit's place and of steps that its line search tries."""
_Key = tuple[tuple[Any, ...], ...]
_STEP = 1e-4
"""Step of central differences by joint values [rad or m], rates and accelerations: truncation 1e-8,
rounding 1e-12."""


def readings(
    channels: Sequence[Channel], scene: Scene, active: Sequence[ActiveEffect] = ()
) -> np.ndarray:
    """Mean readings (M, C) of all channels' C columns, for all M rows of a scene, with effects."""
    chain = EffectChain(active)
    return _predicted(channels, chain, scene, *chain.placed(scene))


def refitted(
    channels: Sequence[Channel], scene: Scene, active: Sequence[ActiveEffect], read: np.ndarray,
    seen: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Predicted readings (M, C) with effects, nuisance fitted to the readings ``read`` (H, C) of
    those measured rows that ``seen`` (H,), boolean, selects."""
    chain = EffectChain(active)
    pose, load = chain.placed(scene)
    some, each = _only(scene, seen), zip(channels, slices(channels), strict=True)
    fitted = [c.fitted(read[seen, of], some, pose) or c for c, of in each]
    return _predicted(fitted, chain, scene, pose, load)


def _only(scene: Scene, seen: np.ndarray) -> Scene:
    """Copy of a scene whose measured rows are only those that ``seen`` (H,), boolean, selects."""
    return replace(scene, held=np.isin(np.arange(len(scene)), np.flatnonzero(scene.held)[seen]))


def slices(channels: Sequence[Channel]) -> tuple[slice, ...]:
    """Slice of each channel's columns among the columns of all channels, in their order."""
    ends = np.cumsum([0, *(len(c.columns) for c in channels)]).tolist()
    return tuple(slice(a, b) for a, b in pairwise(ends))


def _predicted(
    channels: Sequence[Channel], chain: EffectChain, scene: Scene, pose: Pose, load: np.ndarray
) -> np.ndarray:
    parts = [c.predict(chain, scene, pose, load) for c in channels]
    return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)


class Responses:
    """Cache of the readings of one scene with many sets of effects, as `readings` makes them.

    Nuisance in which readings are not linear (a sensor's mounting …) is refitted for each set, so
    that predictions stay near the measured readings. As a fit changes one number at a time, sensor
    poses are kept while the effects on them stay, readings while all effects do.
    """

    def __init__(
        self, scene: Scene, channels: Sequence[Channel], read: np.ndarray, seen: np.ndarray
    ) -> None:
        """Take readings (H, C) of measured rows; nuisance is fitted where ``seen`` (H,) is true."""
        self.scene, self.channels = scene, channels
        self._read, self._seen = read[seen], _only(scene, seen)
        self._placed: dict[_Key, tuple[Pose, np.ndarray]] = {}
        self._readings: dict[_Key, np.ndarray] = {}

    def of(self, active: Sequence[ActiveEffect]) -> np.ndarray:
        """Mean readings (M, C) of every row with effects; a cached array, not to be changed."""
        return _kept(self._readings, _key(active), lambda: self._made(active))

    def _made(self, active: Sequence[ActiveEffect]) -> np.ndarray:
        chain = EffectChain(active)
        early = [a for a in active if not PLACING.isdisjoint(a.effect.stages)]
        pose, load = _kept(self._placed, _key(early), lambda: chain.placed(self.scene))
        each = zip(self.channels, slices(self.channels), strict=True)
        channels = [c.relinearised(self._read[:, of], self._seen, pose) for c, of in each]
        return _predicted(channels, chain, self.scene, pose, load)


def _key(active: Sequence[ActiveEffect]) -> _Key:
    return tuple((a.effect.name, *a.values.items()) for a in active)


def _kept(known: dict[_Key, _T], key: _Key, make: Callable[[], _T]) -> _T:
    """Value of a key in the cache ``known``, else a new one; the least recently used is dropped."""
    value = known.pop(key) if key in known else make()
    if len(known) == _KEPT:
        del known[next(iter(known))]
    known[key] = value
    return value


@dataclass(frozen=True, eq=False)
class Response:
    """Derivatives of a scene's readings (M rows, C columns) by amplitudes of one effect."""

    scene: Scene
    channels: tuple[Channel, ...]

    def tangent(self, effect: Effect, parameter: Parameter, variant: Variant) -> np.ndarray:
        """Change (M, C) of readings per typical size of a parameter at a variant's other values."""
        ((_, change),) = self.changes(effect, [parameter], variant.at)
        return change

    def changes(
        self, effect: Effect, parameters: Sequence[Parameter], at: Values
    ) -> Iterator[tuple[tuple[str, ...], np.ndarray]]:
        """Yield names of amplitudes, and the change (M, C) of readings per typical size of these;
        ``at`` has values of other parameters (a time constant …). Amplitudes that act on different
        columns of the wrench, or on different joints, are changed at once: a change that comes with
        several names holds each in its own column.
        """
        names_of_joints = [f"q{k + 1}" for k in range(self.scene.joints.shape[1])]
        groups: dict[str, list[Parameter]] = {}
        for p in parameters:
            stem, _, end = p.name.rpartition(".")
            by_column = effect.channelwise and end in CHANNELS
            by_joint = effect.stages == ("joint",) and effect.local and end in names_of_joints
            groups.setdefault(f"{stem}." if by_column or by_joint else p.name, []).append(p)
        for group in groups.values():
            names = tuple(p.name for p in group)
            up, down = self._about(effect, at, group)
            if effect.stages != ("joint",):
                yield names, self._read(up) - self._read(down)
                continue
            shift = up.displacement(self.scene) - down.displacement(self.scene)
            change = {n: self._by_joint(shift, j) for j, n in enumerate(names_of_joints)}
            if len(group) > 1:
                yield from (((n,), change[n.rpartition(".")[2]]) for n in names)
            else:
                yield names, np.asarray(sum(change.values()))

    def _about(
        self, effect: Effect, at: Values, parameters: Sequence[Parameter]
    ) -> tuple[EffectChain, EffectChain]:
        """Two chains of one effect, its amplitudes ``parameters`` half a typical size above and
        below 0 (or one and 0, if negative is impossible, as a mass); ``at``: its other values."""
        start = {p.name: p.nominal for p in effect.parameters(self.scene.robot)} | dict(at)
        sizes = ({p.name: s * p.tolerance for p in parameters} for s in (0.5, -0.5, 1.0, 0.0))
        up, down, one, none = (EffectChain([ActiveEffect(effect, start | s)]) for s in sizes)
        try:
            down.theta(self.scene.robot, self.scene.theta)
        except ParameterError:
            return one, none
        return up, down

    def _read(self, chain: EffectChain) -> np.ndarray:
        return _predicted(self.channels, chain, self.scene, *chain.placed(self.scene))

    def _by_joint(self, shift: Value, joint: int) -> np.ndarray:
        """Change (M, C) of all readings by the part of a shift (M, J) that one joint makes."""
        given = (shift.v, shift.d, shift.dd) if isinstance(shift, Jet) else (shift,)
        parts = [s[joint] * x[:, joint, None] for s, x in zip(self._slopes, given, strict=False)]
        return np.asarray(sum(parts))

    @cached_property
    def _slopes(self) -> tuple[np.ndarray, ...]:
        """Derivatives (J, M, C) of readings by joint values, in motion by their rates too."""
        scene, orders = self.scene, 3 if self.scene.moving else 1

        def read(order: int, shift: np.ndarray) -> np.ndarray:
            parts = [shift if k == order else np.zeros_like(shift) for k in range(orders)]
            shifted = replace(scene, q=scene.q + (Jet(*parts) if scene.moving else shift))
            return readings(self.channels, shifted)

        steps = _STEP * np.eye(scene.joints.shape[1])[:, None, :] * np.ones((len(scene), 1))
        return tuple(
            np.stack([(read(k, s) - read(k, -s)) / (2.0 * _STEP) for s in steps])
            for k in range(orders)
        )
