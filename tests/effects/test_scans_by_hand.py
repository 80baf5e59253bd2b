"""Scans of a residual: a shape that lies on a scan's own grid is found at its very place."""

import numpy as np
import pytest
from effect_scenes import static

from wrenchbed import registry
from wrenchbed.effects import cable_pull, environment_contact
from wrenchbed.effects.base import Residual, sides
from wrenchbed.effects.chain import ActiveEffect, respond
from wrenchbed.physics.rotations import apply, sphere

NOISE = np.array([0.02, 0.03, 0.04, 1e-3, 2e-3, 5e-4])
SCENE = static("ur5", 60, 0, seed=3)
ROWS = np.arange(0, 60, 2)
"""Rows that were measured and may be fitted: every other."""


def change(name, given):
    return respond(SCENE, [ActiveEffect.of(SCENE.robot, name, given)]) - respond(SCENE)


def scanned(name, given, centred=True):
    """Proposals for the effect's own signal without noise."""
    effect = registry.load("effects", name)
    seen = change(name, given)[ROWS] / NOISE
    seen = seen - seen.mean(axis=0) if centred else seen
    return effect.scan(SCENE, Residual(ROWS, seen, NOISE, None))


def along(variant, stem):
    return np.array([variant.at[f"{stem}.{a}"] for a in "xyz"])


POINT = (0.03, -0.05, 0.06)


def holder():
    """Where the cable is assumed to hold: at the tool's centre of gravity."""
    rotation, origin = (x[ROWS] for x in SCENE.pose)
    return origin + apply(rotation, SCENE.tool.cog)


@pytest.mark.parametrize("reach", [0.4, 0.8, 1.5, 2.5])
@pytest.mark.parametrize(("way", "share"), [(3, 0.25), (17, 0.5), (30, 0.75), (36, 0.0)])
def test_an_anchor_on_the_grid_is_found_at_its_place_and_length(reach, way, share):
    held = holder()
    anchor = held.mean(axis=0) + reach * sphere(40)[way]
    length = float(np.quantile(np.linalg.norm(held - anchor, axis=1), share))
    given = dict(zip(("anchor.x", "anchor.y", "anchor.z"), anchor, strict=True))
    given |= dict(zip(("point.x", "point.y", "point.z"), SCENE.tool.cog, strict=True))
    found = scanned("cable.pull", given | {"stiffness": 3.0, "length": length})
    assert len(found) == 3
    first = found[0]
    assert along(first, "anchor") == pytest.approx(anchor)
    assert first.at["length"] == pytest.approx(length)
    assert along(first, "point") == pytest.approx(SCENE.tool.cog, abs=1e-4)
    assert first.free == ("stiffness",) and set(first.shape) == set(first.at)
    assert {v.label for v in found} == {"slack in part"}
    assert {v.weight for v in found} == {0.1}


def test_a_cable_does_not_push():
    pull = np.random.default_rng(5).standard_normal((20, 3))
    y = np.concatenate([pull, np.cross(POINT, pull)], axis=1) / NOISE
    residual = Residual(np.arange(20), y - y.mean(axis=0), NOISE, None)
    (gain, pushed), _ = cable_pull._gains(np.stack([pull, -pull]), residual)
    assert gain > pushed == 0.0


def test_a_point_that_lies_far_from_the_tool_is_brought_back():
    held = holder()
    anchor = held.mean(axis=0) + 0.8 * sphere(40)[7]
    given = dict(zip(("anchor.x", "anchor.y", "anchor.z"), anchor, strict=True))
    given |= {"stiffness": 3.0, "point.x": 0.9, "point.z": -0.9}
    for v in scanned("cable.pull", given):
        assert np.abs(along(v, "point")).max() <= 0.3


@pytest.mark.parametrize("share", environment_contact.DEPTHS)
@pytest.mark.parametrize("way", [11, 140, 250, 388])
def test_a_plane_on_the_grid_is_found_with_its_depth_and_drag(way, share):
    normal = sphere(400)[way]
    rotation, position = (x[ROWS] for x in SCENE.pose)
    height = (position + apply(rotation, 2.0 * SCENE.tool.cog)) @ normal
    depth = float(np.quantile(height, share))
    slide = 0.3 * np.cross(normal, [0.6, 0.0, 0.8])
    given = {f"normal.{a}": n for a, n in zip("xyz", normal, strict=True)}
    given |= {f"slide.{a}": s for a, s in zip("xyz", slide, strict=True)}
    found = scanned("environment.contact", given | {"stiffness": 400.0, "depth": depth}, False)
    first = found[0]
    assert along(first, "normal") == pytest.approx(normal)
    assert first.at["depth"] == pytest.approx(depth)
    assert along(first, "slide") == pytest.approx(slide, abs=1e-6)
    assert (first.at["power"], first.at["reach"]) == (1.0, 1.0)
    assert not along(first, "aside").any()
    assert first.free == ("stiffness",) and set(first.shape) == set(first.at)
    assert [v.label for v in found] == [f"from {v.detail['side']}" for v in found]
    assert {v.weight for v in found} == {0.1}


def test_a_plane_does_not_pull():
    """Of what pulls the tip into a plane no proposal is a plane that pulls: all are stiff."""
    normal = sphere(400)[140]
    rotation, position = (x[ROWS] for x in SCENE.pose)
    height = (position + apply(rotation, 2.0 * SCENE.tool.cog)) @ normal
    given = {f"normal.{a}": n for a, n in zip("xyz", normal, strict=True)}
    given |= {"stiffness": -400.0, "depth": float(np.quantile(height, 0.12))}
    signal = change("environment.contact", given)[ROWS] / NOISE
    for v in scanned("environment.contact", given, False):
        shown = change("environment.contact", dict(v.at) | {"stiffness": 400.0})[ROWS] / NOISE
        assert np.sum(shown * signal) > 0.0


@pytest.mark.parametrize(
    ("way", "grip", "lean"),
    [(20, 0.08, 0.0), (60, 0.16, 0.2), (120, 0.24, -0.4), (150, 0.32, 0.0), (70, 0.0, 0.2)],
)
def test_a_loose_parts_way_is_proposed_about_where_it_is(way, grip, lean):
    axis = sphere(400)[way]
    given = {f"way.{a}": n for a, n in zip("xyz", axis, strict=True)}
    given |= {"shift": 2e-3, "grip": grip, "lean": lean}
    found = scanned("tool.loose", given)
    signal = change("tool.loose", given)[ROWS] / NOISE
    signal = signal - signal.mean(axis=0)
    explained = []
    for v in found:
        sticks = v.at["grip"] > 0.0
        assert v.label == f"{'sticks' if sticks else 'falls'} along {sides(along(v, 'way'))}"
        assert v.shape == ("way.x", "way.y", "way.z", "lean") + ("grip",) * sticks
        assert v.free == ("shift",) and v.weight == 0.05
        assert np.linalg.norm(along(v, "way")) == pytest.approx(1.0)
        shown = change("tool.loose", dict(v.at) | {"shift": 1e-3})[ROWS] / NOISE
        shown = shown - shown.mean(axis=0)
        explained.append(np.sum(shown * signal) / np.linalg.norm(shown) / np.linalg.norm(signal))
        assert abs(along(v, "way") @ axis) > 0.9
    assert len(found) == 4
    assert max(explained) > 0.97 and min(explained) > 0.75


@pytest.mark.parametrize(("joint", "order"), [(2, 5), (3, 31), (5, 144), (6, 220)])
def test_a_wave_is_found_by_its_order_in_the_joint_that_makes_it(joint, order):
    effect, name = registry.load("effects", "joint.gear_error"), "joint.gear_error"
    given = {f"sin.q{joint}": 1e-3, f"cos.q{joint}": -5e-4, "order": float(order)}
    signal = change(name, given)

    def tangent(parameter, at):
        return change(name, {**at, parameter: 1e-6}) / 1e-6 * 3e-4

    (found,) = effect.scan(SCENE, Residual(ROWS, signal[ROWS] / NOISE, NOISE, tangent))
    assert found.free == (f"sin.q{joint}", f"cos.q{joint}")
    assert dict(found.at) == {"order": float(order)}
    assert (found.shape, dict(found.detail)) == (("order",), {"joint": joint})
    assert found.label == f"joint {joint}, {order} waves a turn"
    # as likely as one of the 36 known ones, spread over 216 orders of six joints
    assert found.weight == pytest.approx(36.0 / (216 * 6))
    none = Residual(ROWS, 0.0 * signal[ROWS], NOISE, tangent)
    assert effect.scan(SCENE, none) == ()


@pytest.mark.parametrize("name", ["cable.pull", "environment.contact"])
def test_where_no_joints_are_known_no_place_is_proposed(name):
    scene = static("oriented", 20, 0)
    seen = Residual(np.arange(20), np.ones((20, 6)), NOISE, None)
    assert registry.load("effects", name).scan(scene, seen) == ()
