"""Members of effects that assume no formula: few columns, linear, with curves of what they add."""

import numpy as np
import pytest
from effect_scenes import scene_of

from wrenchbed import registry
from wrenchbed.effects.base import Variant
from wrenchbed.effects.chain import ActiveEffect, effects, respond
from wrenchbed.effects.scene import LEAST_MOVE_S, PEAK_SPEED, examples
from wrenchbed.physics.wrench import CHANNELS

MOST = 8
"""Amplitudes of a channel, so that an analysis stays short."""
NAMES = (
    "sensor.creep", "sensor.drift", "sensor.hysteresis", "sensor.nonlinearity",
    "sensor.temperature",
)  # fmt: skip


def free_forms(name: str, scene) -> tuple[Variant, ...]:
    return registry.load("effects", name).free_forms(scene)


def test_these_effects_have_a_free_form():
    scene = examples(registry.load("robots", "ur5"))[0]
    assert tuple(n for n, e in effects().items() if e.free_forms(scene)) == NAMES
    # of a temperature that nobody recorded there is none
    assert not free_forms("sensor.temperature", scene_of("ur5 static"))


@pytest.mark.parametrize("name", NAMES)
def test_it_has_few_amplitudes_that_do_not_grow_with_their_order(name):
    robot = registry.load("robots", "ur5")
    known = registry.load("effects", name).parameters(robot)
    for v in free_forms(name, examples(robot)[0]):
        assert v.free_form and not v.shape
        channels = {n.rpartition(".")[2] for n in v.free} & {*CHANNELS}
        assert len(v.free) <= MOST * max(len(channels), 1)
        for c in channels or {""}:
            stems = [n for n in v.free if n.endswith(c)]
            first = known[known.index(stems[0])].tolerance
            assert all(known[known.index(n)].tolerance <= first for n in stems)


@pytest.mark.parametrize("name", NAMES)
def test_it_is_linear_and_adds_to_its_channels_only(name):
    robot = registry.load("robots", "ur5")
    scene, effect = examples(robot)[0], registry.load("effects", name)
    rng = np.random.default_rng(1)
    rigid = respond(scene)
    for v in free_forms(name, scene):
        size = {p.name: p.tolerance for p in effect.parameters(robot)}
        once = {n: float(size[n] * rng.standard_normal()) for n in v.free}

        def added(factor, v=v, once=once):
            values = dict(v.at) | {n: factor * x for n, x in once.items()}
            active = ActiveEffect.of(robot, name, values)
            return respond(scene, [active]) - rigid

        assert np.allclose(added(2.0), 2.0 * added(1.0), rtol=1e-9, atol=1e-12)
        on = {n.rpartition(".")[2] for n in v.free} & {*CHANNELS} or {*CHANNELS}
        off = [k for k, c in enumerate(CHANNELS) if c not in on]
        assert np.abs(added(1.0)).max() > 0.0
        assert not added(1.0)[:, off].any()


@pytest.mark.parametrize("name", NAMES)
def test_its_curves_hold_all_of_its_amplitudes(name):
    scene = examples(registry.load("robots", "ur5"))[0]
    for v in free_forms(name, scene):
        curves = registry.load("effects", name).curves(scene, v)
        assert sorted(n for c in curves for n in c.names) == sorted(v.free)
        for c in curves:
            assert c.columns.shape == (len(c.x), len(c.names))
            assert np.isfinite(c.columns).all() and np.abs(c.columns).max() > 0.0


def test_the_curve_of_a_drift_is_what_it_adds():
    robot = registry.load("robots", "ur5")
    scene, effect = scene_of("ur5 static"), registry.load("effects", "sensor.drift")
    (v,) = (v for v in effect.free_forms(scene) if v.detail.get("channel") == "fy")
    (curve,) = effect.curves(scene, v)
    values = {n: 1e-3 / (k + 1) for k, n in enumerate(v.free)}
    active = ActiveEffect.of(robot, "sensor.drift", dict(v.at) | values)
    added = (respond(scene, [active]) - respond(scene))[:, 1]
    y = curve.columns @ np.array([values[n] for n in curve.names])
    assert np.allclose(np.interp(scene.age, curve.x, y), added, atol=0.01 * np.ptp(added))
    assert (curve.channel, curve.x_unit, curve.y_unit) == ("fy", "s", "N")


def test_jolts_are_the_inertia_of_minimum_jerk_moves_between_poses():
    scene = scene_of("ur5 static")
    assert np.abs(scene.jolts[scene.held]).max() < 1e-12
    assert not scene_of("ur5 motion").jolts.any()
    at, robot = np.flatnonzero(scene.held), scene.robot
    cog, top = np.asarray(scene.tool.cog), np.array([j.speed for j in robot.joints])
    for k in (3, 11):
        q, change = scene.joints[at[k]], np.diff(scene.joints[at[k : k + 2]], axis=0)[0]
        lasts = max(PEAK_SPEED * np.abs(change / top).max(), LEAST_MOVE_S)
        t = np.linspace(0.0, lasts, 4001)
        share = 10 * (t / lasts) ** 3 - 15 * (t / lasts) ** 4 + 6 * (t / lasts) ** 5
        rotation, position = robot.sensor_pose(q + share[:, None] * change, scene.theta)
        place = position + rotation @ cog
        a = np.gradient(np.gradient(place, t, axis=0), t, axis=0)
        force = -float(scene.tool.mass) * np.einsum("nij,ni->nj", rotation, a)
        steps = np.arange(1, at[k + 1] - at[k])
        at_rows = [int(np.argmin(np.abs(share - i / (at[k + 1] - at[k])))) for i in steps]
        assert np.allclose(scene.jolts[at[k] + steps, :3], force[at_rows], atol=0.02)
        assert np.abs(force).max() > 0.5
