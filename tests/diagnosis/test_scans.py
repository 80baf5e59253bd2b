"""Effects that act by jumps look through a residual and propose shapes near the true ones."""

import numpy as np
import pytest

from scenes import still
from wrenchbed import registry
from wrenchbed.effects.base import Residual, Variant
from wrenchbed.effects.chain import ActiveEffect, Response, respond

NOISE = np.array([0.02, 0.02, 0.03, 1e-3, 1e-3, 5e-4])
SCENE = still("ur5", 70)


def proposals(name, values):
    """Variants found for the effect's own signal with noise, best first, and that signal."""
    effect = registry.load("effects", name)
    signal = respond(SCENE, [ActiveEffect.of(SCENE.robot, name, values)]) - respond(SCENE)
    rng = np.random.default_rng(1)
    seen = (signal - signal.mean(axis=0)) / NOISE + 0.3 * rng.standard_normal(signal.shape)
    response, known = (
        Response(SCENE, respond(SCENE)),
        {p.name: p for p in effect.parameters(SCENE.robot)},
    )

    def tangent(parameter, at):
        return response.tangent(effect, known[parameter], Variant(name, (parameter,), at))

    rows = np.arange(len(SCENE))
    return effect.scan(SCENE, Residual(rows, seen, NOISE, tangent)), signal / NOISE


def alike(name, variant, signal):
    """Cosine between a variant's best response and the signal, both without their means."""
    effect = registry.load("effects", name)
    columns = []
    for free in variant.free:
        size = {p.name: p.tolerance for p in effect.parameters(SCENE.robot)}[free]
        active = ActiveEffect.of(SCENE.robot, name, dict(variant.at) | {free: size})
        change = (respond(SCENE, [active]) - respond(SCENE)) / NOISE
        columns.append((change - change.mean(axis=0)).ravel())
    design = np.stack(columns, axis=1)
    wanted = (signal - signal.mean(axis=0)).ravel()
    told = design @ np.linalg.lstsq(design, wanted, rcond=None)[0]
    return float(told @ wanted / (np.linalg.norm(told) * np.linalg.norm(wanted)))


@pytest.mark.parametrize(("joint", "order"), [(2, 50), (4, 101), (6, 7)])
def test_the_order_and_joint_of_a_gear_are_found(joint, order):
    given = {f"sin.q{joint}": 2e-3, f"cos.q{joint}": 1e-3, "order": float(order)}
    (found,), _ = proposals("joint.gear_error", given)
    assert found.at["order"] == order
    assert found.detail == {"joint": joint}


@pytest.mark.parametrize(
    ("name", "values"),
    [
        (
            "cable.pull",
            {
                "stiffness": 2.0, "length": 0.9, "anchor.x": 0.3, "anchor.y": -0.8, "anchor.z": 1.2,
                "point.x": -0.02, "point.y": 0.05, "point.z": 0.03,
            },
        ),
        (
            "tool.loose",
            {
                "shift": 2e-3, "way.x": 0.6, "way.y": -0.5, "way.z": 0.62, "lean": 0.2,
                "grip": 0.2,
            },
        ),
        (
            "environment.contact",
            {
                "stiffness": 300.0, "normal.x": -0.3, "normal.y": 0.4, "normal.z": 0.87,
                "depth": -0.1, "slide.x": 0.1,
            },
        ),
    ],
)  # fmt: skip
def test_a_shape_near_the_true_one_is_proposed(name, values):
    if name == "environment.contact":  # so that some of the poses touch
        from wrenchbed.effects.environment_contact import tip
        from wrenchbed.physics.rotations import apply

        rotation, position = SCENE.pose
        height = (position + apply(rotation, tip(SCENE))) @ np.array([-0.3, 0.4, 0.87])
        values = values | {"depth": float(np.quantile(height, 0.15))}
    found, signal = proposals(name, values)
    assert np.abs(signal).max() > 3.0
    assert max(alike(name, v, signal) for v in found) > 0.9


def test_nothing_is_proposed_that_could_not_be_seen():
    for name in ("sensor.gain", "base.tilt"):
        effect = registry.load("effects", name)
        assert effect.scan(SCENE, Residual(np.arange(3), np.zeros((3, 6)), NOISE, None)) == ()
