"""Readings of many sets of effects in one scene are those of each set alone, to the last bit."""

import numpy as np
import pytest
from effect_scenes import SCENES, scene_of

from wrenchbed import registry
from wrenchbed.effects.chain import ActiveEffect, EffectChain, Responses, respond

NAMES = ("joint.offset", "cable.pull", "sensor.gain", "tool.mass", "base.tilt", "joint.compliance")


def sets(scene, count=30):
    """Sets of effects whose numbers change a few at a time."""
    rng, robot = np.random.default_rng(2), scene.robot
    effects = [e for n in NAMES if (e := registry.load("effects", n)).variants(scene)]
    values = {e.name: e.values(robot, {}) for e in effects}
    for _ in range(count):
        changed = effects[rng.integers(len(effects))]
        names = [p for p in changed.parameters(robot) if p.nominal == 0.0]
        p = names[rng.integers(len(names))]
        size = rng.choice([0.0, 0.5, 1.0]) * p.tolerance
        values[changed.name] = {**values[changed.name], p.name: size}
        some = [e for e in effects if rng.random() < 0.7]
        yield [ActiveEffect(e, values[e.name]) for e in some]


@pytest.mark.parametrize("label", SCENES)
def test_readings_are_those_of_each_set_alone(label):
    scene = scene_of(label)
    kept = Responses(scene)
    for active in sets(scene):
        assert np.array_equal(kept.of(active), respond(scene, active), equal_nan=True)


def test_a_pose_is_made_once_while_only_later_stages_change(monkeypatch):
    scene = scene_of(next(iter(SCENES)))
    made = []
    placed = EffectChain.placed
    monkeypatch.setattr(
        EffectChain, "placed", lambda self, scene: made.append(1) or placed(self, scene)
    )
    kept = Responses(scene)
    offset, gain = (registry.load("effects", n) for n in ("joint.offset", "sensor.gain"))
    for k in range(5):
        numbers = gain.values(scene.robot, {"gain.fx": 0.01 * k})
        kept.of([ActiveEffect.of(scene.robot, "joint.offset", {}), ActiveEffect(gain, numbers)])
    assert len(made) == 1
    name = offset.parameters(scene.robot)[0].name
    kept.of([ActiveEffect.of(scene.robot, "joint.offset", {name: 1e-3})])
    assert len(made) == 2
