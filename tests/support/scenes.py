"""Scenes that tests of effects and twins share."""

from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.effects.base import Effect, Variant
from wrenchbed.effects.chain import ActiveEffect
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.time_derivatives import Jet


def still(name: str, n: int = 24) -> Scene:
    """Random poses at rest, ten seconds apart, warming up by 5 K."""
    robot = registry.load("robots", name)
    q = robot.sample(n, np.random.default_rng(3))
    rows = np.ones(n, dtype=bool)
    warmth = np.linspace(0.0, 5.0, n)
    return Scene(
        robot,
        robot.parameters.nominal,
        np.array(robot.gravity),
        q,
        10.0 * np.arange(n),
        rows,
        warmth,
    )


def moving(rows: int = 251, rate: float = 125.0) -> Scene:
    """A multisine of the UR5, exact jets."""
    robot, t = registry.load("robots", "ur5"), np.arange(rows) / rate
    rng = np.random.default_rng(1)
    v = np.tile([0.0, -1.2, 1.4, -1.6, 1.5, 0.0], (rows, 1))
    d, dd = np.zeros((rows, 6)), np.zeros((rows, 6))
    for k in (1, 2, 3):
        w, size = np.pi * k, rng.uniform(-0.25, 0.25, 6) / k
        angle = w * t[:, None] + rng.uniform(0.0, 6.0, 6)
        v, d = v + size * np.sin(angle), d + size * w * np.cos(angle)
        dd = dd - size * w * w * np.sin(angle)
    held, warmth = np.ones(rows, dtype=bool), np.linspace(0.0, 5.0, rows)
    gravity = np.array(robot.gravity)
    return Scene(robot, robot.parameters.nominal, gravity, Jet(v, d, dd), t, held, warmth)


def sized(effect: Effect, scene: Scene, variant: Variant, times: float = 2.0) -> ActiveEffect:
    """A variant with its amplitudes at several times their typical size."""
    known = effect.parameters(scene.robot)
    values: dict[str, Any] = dict(variant.at)
    values |= {n: times * known[known.index(n)].tolerance for n in variant.free}
    return ActiveEffect.of(scene.robot, effect.name, values)
