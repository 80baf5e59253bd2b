"""In which ways an effect may show: what is free, where shapes begin, what counts how much."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from effect_scenes import scene_of

from wrenchbed import registry

DECLARED = Path(__file__).parents[1] / "data" / "effect_variants.json"
"""Variants by scene and effect: label, free amplitudes, where shapes begin, shape, detail, weight,
rivals, usual amplitudes. `python tests/effects/test_variants.py` writes them anew."""
CASES = {
    "ur5 static": [*registry.names("effects")],
    "ur5 motion": ["link.length", "timing.delay", "timing.lowpass", "timing.skew", "tool.inertia"],
    "medrue static": ["cable.torsion", "joint.clearance", "joint.gear_error", "link.length",
                      "sensor.temperature"],
}  # fmt: skip


def declared(name, scene):
    effect = registry.load("effects", name)
    return [
        [v.label, [*v.free], dict(v.at), [*v.shape], dict(v.detail), v.weight, [*v.rivals],
         [*effect.usual(v)]]
        for v in effect.variants(scene_of(scene))
    ]  # fmt: skip


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


if __name__ == "__main__":
    every = {s: {n: declared(n, s) for n in names} for s, names in CASES.items()}
    lines = [
        f'"{s}": {{\n' + ",\n".join(f'"{n}": {json.dumps(w)}' for n, w in own.items()) + "\n}"
        for s, own in every.items()
    ]
    DECLARED.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
