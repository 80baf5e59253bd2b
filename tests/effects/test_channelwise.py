"""Many sets of effects, or many amplitudes, read together what each reads alone."""

import numpy as np
import pytest
from effect_scenes import NAMES, SCENES, columns, scene_of

from wrenchbed import registry
from wrenchbed.channels.response import Response, Responses
from wrenchbed.channels.wrench import CHANNEL as WRENCH
from wrenchbed.effects.base import Effect
from wrenchbed.effects.chain import ActiveEffect, EffectChain, respond
from wrenchbed.physics.wrench import CHANNELS


def amplitudes(name: str, scene: str) -> dict[tuple, list[str]]:
    """Names of amplitudes that end with a channel, by the shape that they have."""
    found: dict[tuple, list[str]] = {}
    for amplitude, at in columns(name, scene):
        if amplitude.rpartition(".")[2] in CHANNELS:
            found.setdefault(tuple(sorted(at.items())), []).append(amplitude)
    return found


EVERY = [(name, scene) for name in NAMES for scene in SCENES if amplitudes(name, scene)]
CASES = [(name, scene) for name, scene in EVERY if registry.load("effects", name).channelwise]


def slope(effect: Effect, label: str, at: dict, amplitude: str) -> np.ndarray:
    """Change of the readings (M, 6) per typical size of one amplitude, by the whole chain."""
    scene = scene_of(label)
    known = effect.parameters(scene.robot)
    size = known[known.index(amplitude)].tolerance
    ends = [
        respond(
            scene,
            [ActiveEffect(effect, effect.values(scene.robot, at | {amplitude: half * size}))],
        )
        for half in (0.5, -0.5)
    ]
    return ends[0] - ends[1]


def test_one_effect_of_channels_is_not_channelwise():
    assert len({name for name, _ in CASES}) >= 8
    assert {name for name, _ in EVERY} - {name for name, _ in CASES} == {"sensor.crosstalk"}


@pytest.mark.parametrize("name, scene", CASES, ids=str)
def test_an_amplitude_changes_its_own_channel_alone(name, scene):
    effect = registry.load("effects", name)
    for shape, names in amplitudes(name, scene).items():
        for amplitude in names:
            change = slope(effect, scene, dict(shape), amplitude)
            channel = CHANNELS.index(amplitude.rpartition(".")[2])
            assert np.abs(np.delete(change, channel, axis=1)).max() == 0.0, amplitude


@pytest.mark.parametrize("name, scene", EVERY, ids=str)
def test_changed_together_they_are_what_each_is_alone(name, scene):
    effect, rows = registry.load("effects", name), scene_of(scene)
    known = effect.parameters(rows.robot)
    for shape, names in amplitudes(name, scene).items():
        found = Response(rows, (WRENCH,)).changes(
            effect, [known[known.index(n)] for n in names], dict(shape)
        )
        for group, change in found:
            assert len(group) == 1 or effect.channelwise
            for amplitude in group:
                own = [CHANNELS.index(amplitude.rpartition(".")[2])]
                some = own if len(group) > 1 else slice(None)
                alone = slope(effect, scene, dict(shape), amplitude)[:, some]
                size = max(np.abs(alone).max(), 1e-9)
                assert np.abs(change[:, some] - alone).max() < 1e-9 * size + 1e-12, amplitude


# ---- sets of effects in one scene

SOME = ("joint.offset", "cable.pull", "sensor.gain", "tool.mass", "base.tilt", "joint.compliance")


def sets(scene, count=30):
    """Sets of effects whose numbers change a few at a time."""
    rng, robot = np.random.default_rng(2), scene.robot
    effects = [e for n in SOME if (e := registry.load("effects", n)).variants(scene)]
    values = {e.name: e.values(robot, {}) for e in effects}
    for _ in range(count):
        changed = effects[rng.integers(len(effects))]
        names = [p for p in changed.parameters(robot) if p.nominal == 0.0]
        p = names[rng.integers(len(names))]
        size = rng.choice([0.0, 0.5, 1.0]) * p.tolerance
        values[changed.name] = {**values[changed.name], p.name: size}
        some = [e for e in effects if rng.random() < 0.7]
        yield [ActiveEffect(e, values[e.name]) for e in some]


def responses(scene):
    poses = int(scene.held.sum())
    return Responses(scene, (WRENCH,), np.zeros((poses, 6)), np.zeros(poses, dtype=bool))


@pytest.mark.parametrize("label", SCENES)
def test_readings_are_those_of_each_set_alone(label):
    scene = scene_of(label)
    kept = responses(scene)
    for active in sets(scene):
        assert np.array_equal(kept.of(active), respond(scene, active), equal_nan=True)


def test_a_pose_is_made_once_while_only_later_stages_change(monkeypatch):
    scene = scene_of(next(iter(SCENES)))
    made = []
    placed = EffectChain.placed
    monkeypatch.setattr(
        EffectChain, "placed", lambda self, scene: made.append(1) or placed(self, scene)
    )
    kept = responses(scene)
    offset, gain = (registry.load("effects", n) for n in ("joint.offset", "sensor.gain"))
    for k in range(5):
        numbers = gain.values(scene.robot, {"gain.fx": 0.01 * k})
        kept.of([ActiveEffect.of(scene.robot, "joint.offset", {}), ActiveEffect(gain, numbers)])
    assert len(made) == 1
    name = offset.parameters(scene.robot)[0].name
    kept.of([ActiveEffect.of(scene.robot, "joint.offset", {name: 1e-3})])
    assert len(made) == 2
