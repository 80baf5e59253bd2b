"""In which ways an effect may show: what is free, where shapes begin, forms without a formula."""

from dataclasses import replace

import numpy as np
import pytest
from effect_scenes import scene_of

from wrenchbed import registry
from wrenchbed.effects.base import Variant
from wrenchbed.effects.chain import ActiveEffect, effects, respond
from wrenchbed.effects.scene import LEAST_MOVE_S, PEAK_SPEED, examples
from wrenchbed.physics.wrench import CHANNELS

SOFT = ("compliance.x", "compliance.y", "compliance.z")
WEIGHT = 9.80665 * float(scene_of("ur5 static").tool.mass)


@pytest.mark.parametrize(
    ("name", "given", "size", "unit"),
    [
        ("cable.pull", {"pull.x": 2.0, "pull.z": -1.5}, {"largest_force": 2.5}, "N"),
        ("tool.flexure", dict.fromkeys(SOFT, 1e-4), {"sag": WEIGHT * 1e-4}, "m"),
        ("tool.slide", {"rate.x": 3e-6, "rate.z": 4e-6}, {"moved": 5e-6 * 295.0}, "m"),
        ("sensor.drift", {"rate.fy": -1e-3}, {"largest_change.fy": -0.295}, "N"),
    ],
)
def test_a_size_is_the_physical_quantity_in_a_scene(name, given, size, unit):
    scene, effect = scene_of("ur5 static"), registry.load("effects", name)
    values = effect.values(scene.robot, given)
    found = effect.size(scene, Variant("", tuple(given)), values)
    assert found == {n: (pytest.approx(x), unit) for n, x in size.items()}


def test_a_channel_without_load_is_never_clipped():
    """A tool whose weight acts along the sensor's z at the origin: one force, no torque."""
    rows = scene_of("oriented static")
    upright = np.tile([1.0, 0.0, 0.0, 0.0], (len(rows), 1))
    theta = rows.robot.theta_of_tool(rows.theta, 1.0, (0.0, 0.0, 0.0))
    still = replace(rows, q=upright, theta=theta)
    found = registry.load("effects", "sensor.saturation").variants(still)
    assert {v.free for v in found} == {("share.fz",)}


NEEDS_JOINTS = (
    "base.compliance cable.pull cable.torsion drive.constant drive.offset environment.contact "
    "joint.backlash joint.clearance "
    "joint.compliance joint.gear_error joint.offset link.length"
).split()


@pytest.mark.parametrize("name", registry.names("effects"))
def test_what_sits_in_the_arm_or_outside_it_needs_the_arms_joints(name):
    effect, scene = registry.load("effects", name), scene_of("oriented static")
    between = effect.between_rows or "static" not in effect.modes
    rows = replace(scene, warmth=np.linspace(0.0, 5.0, len(scene)))
    assert bool(effect.variants(rows)) == (name not in NEEDS_JOINTS and not between)
    assert effect.applies(registry.load("robots", "ur5"))
    on_oriented = effect.applies(registry.load("robots", "oriented"))
    assert on_oriented == (name not in (*NEEDS_JOINTS, "tool.inertia"))  # or an accelerometer


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
        curves = effect.curves(scene, v)
        assert sorted(n for c in curves for n in c.names) == sorted(v.free)


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
