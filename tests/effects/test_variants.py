"""In which ways an effect may show: what is free, where shapes begin, what counts how much."""

import json
from collections import Counter
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from effect_scenes import scene_of, variants

from wrenchbed import registry
from wrenchbed.physics.rotations import apply
from wrenchbed.physics.wrench import CHANNELS, wrench

DECLARED = Path(__file__).parents[1] / "data" / "effect_variants.json"
"""Variants by scene and effect: label, free amplitudes, where shapes begin, shape, detail, weight,
rivals. `python tests/effects/test_variants.py` writes them anew."""
BY_HAND = ("cable.pull", "environment.contact", "sensor.jump", "sensor.saturation")
"""Effects that begin where the rows say: see below."""
CASES = {
    "ur5 static": [n for n in registry.names("effects") if n not in BY_HAND],
    "ur5 motion": ["link.length", "timing.delay", "timing.lowpass", "timing.skew", "tool.inertia"],
    "medrue static": ["cable.torsion", "joint.clearance", "joint.gear_error", "link.length",
                      "sensor.temperature"],
}  # fmt: skip


def declared(name, scene):
    found = registry.load("effects", name).variants(scene_of(scene))
    return [
        [v.label, [*v.free], dict(v.at), [*v.shape], dict(v.detail), v.weight, [*v.rivals]]
        for v in found
    ]


def nearly(x):
    """The same with numbers that may differ by rounding."""
    if isinstance(x, dict):
        return {k: nearly(v) for k, v in x.items()}
    return pytest.approx(x, rel=1e-6, abs=1e-9) if isinstance(x, float) else x


@pytest.mark.parametrize("scene", CASES)
def test_the_ways_of_every_effect_are_those_written_down(scene):
    kept = json.loads(DECLARED.read_text(encoding="utf-8"))[scene]
    assert list(kept) == CASES[scene]
    for name, ways in kept.items():
        found = declared(name, scene)
        assert [w[0] for w in found] == [w[0] for w in ways], name
        for now, before in zip(found, ways, strict=True):
            assert now == [nearly(x) for x in before], name


@pytest.mark.parametrize("scene", ["ur5 static", "medrue static"])
def test_a_level_begins_where_a_known_share_of_the_rows_is_clipped(scene):
    rows = scene_of(scene)
    load = np.abs(wrench(*rows.pose, rows.tool, rows.gravity))[rows.held]
    found = variants("sensor.saturation", scene)
    for v in found:
        assert v.shape == tuple(v.at)
        assert [n.split(".")[1] for n in v.free] == [n.split(".")[1] for n in v.at]
    for k, c in enumerate(CHANNELS):
        levels = [v.at[f"level.{c}"] for v in found if v.label == c]
        clipped = [(load[:, k] > level).mean() for level in levels]
        assert clipped == pytest.approx([0.30, 0.15, 0.05], abs=1.0 / len(load))
        for together in ("forces" if k < 3 else "torques", "all"):
            assert [v.at[f"level.{c}"] for v in found if v.label == together] == levels
    assert Counter(v.label for v in found) == dict.fromkeys(
        (*CHANNELS, "forces", "torques", "all"), 3
    )


def test_a_channel_without_load_is_never_clipped():
    """A tool whose weight acts along the sensor's z at the origin: one force, no torque."""
    rows = scene_of("oriented static")
    upright = np.tile([1.0, 0.0, 0.0, 0.0], (len(rows), 1))
    theta = rows.robot.theta_of_tool(rows.theta, 1.0, (0.0, 0.0, 0.0))
    still = replace(rows, q=upright, theta=theta)
    found = registry.load("effects", "sensor.saturation").variants(still)
    assert {v.free for v in found} == {("share.fz",)}


def test_a_plane_begins_on_each_side_at_a_share_of_the_rows():
    rows = scene_of("ur5 static")
    rotation, position = rows.pose
    tip = (position + apply(rotation, 2.0 * rows.tool.cog))[rows.held]
    found = variants("environment.contact", "ur5 static")
    assert len(found) == 26 * 3
    for k, v in enumerate(found):
        normal = np.array([v.at[f"normal.{a}"] for a in "xyz"])
        assert np.linalg.norm(normal) == pytest.approx(1.0)
        assert np.ptp(np.abs(normal[normal != 0.0])) < 1e-12  # an axis or a diagonal
        signs = "".join("−+"[int(n > 0)] + a for n, a in zip(normal, "xyz", strict=True) if n)
        assert dict(v.detail) == {"side": signs}
        share = (0.05, 0.15, 0.35)[k % 3]
        touching = (tip @ normal < v.at["depth"]).mean()
        assert touching == pytest.approx(share, abs=1.0 / len(tip))
        assert v.label == f"from {signs}, {share:.0%} of rows"
        rest = {n: x for n, x in v.at.items() if not n.startswith("normal.") and n != "depth"}
        drag = {f"{stem}.{a}": 0.0 for stem in ("slide", "aside") for a in "xyz"}
        assert rest == drag | {"power": 1.0, "reach": 1.0}
        assert set(v.shape) == set(v.at)


def test_a_cable_is_always_taut_or_slack_in_a_part_of_the_rows():
    rows = scene_of("ur5 static")
    position = rows.pose[1][rows.held]
    taut, *slack = variants("cable.pull", "ur5 static")
    assert taut.free == ("stiffness", "pull.x", "pull.y", "pull.z")
    cog = {f"point.{a}": c for a, c in zip("xyz", rows.tool.cog, strict=True)}
    assert dict(taut.at) == pytest.approx(cog)
    assert taut.shape == tuple(cog)
    assert taut.weight == 4.0 and {v.weight for v in slack} == {1.0}
    # anchors level with the workspace or above it, in 17 directions, at two distances
    assert len(slack) == 17 * 2 * 2
    seen = Counter()
    for v in slack:
        anchor = np.array([v.at[f"anchor.{a}"] for a in "xyz"])
        line = anchor - position.mean(axis=0)
        far = np.linalg.norm(position - anchor, axis=1)
        reach = round(float(np.linalg.norm(line)), 9)
        shorter = round(float((far < v.at["length"]).mean()), 1)
        seen[reach, shorter] += 1
        assert line[2] > -1e-9
        assert {n: v.at[n] for n in cog} == pytest.approx(cog)
        assert set(v.shape) == set(v.at)
        assert v.free == ("stiffness",)
    assert seen == dict.fromkeys(product((0.6, 1.3), (0.3, 0.7)), 17)
    unit = np.array([[v.at[f"anchor.{a}"] for a in "xyz"] for v in slack]) - position.mean(axis=0)
    unit = np.unique(np.round(unit / np.linalg.norm(unit, axis=1, keepdims=True), 9), axis=0)
    assert len(unit) == 17


NEEDS_JOINTS = (
    "base.compliance cable.pull cable.torsion environment.contact joint.backlash joint.clearance "
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


if __name__ == "__main__":
    every = {s: {n: declared(n, s) for n in names} for s, names in CASES.items()}
    lines = [
        f'"{s}": {{\n' + ",\n".join(f'"{n}": {json.dumps(w)}' for n, w in own.items()) + "\n}"
        for s, own in every.items()
    ]
    DECLARED.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
