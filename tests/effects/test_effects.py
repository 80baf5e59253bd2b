"""One contract for every effect."""

import numpy as np
import pytest
from effect_scenes import (
    BLIND,
    NAMES,
    NOISE,
    SCENES,
    SEEN,
    change,
    columns,
    plain,
    scene_of,
    typical,
    variants,
)

from wrenchbed import registry
from wrenchbed.effects import base
from wrenchbed.effects.base import RowEffect
from wrenchbed.effects.chain import ActiveEffect, respond
from wrenchbed.errors import ParameterError

each_effect = pytest.mark.parametrize("name", NAMES)
each_case = pytest.mark.parametrize(
    "name, scene", [(n, s) for n in NAMES for s in SCENES], ids=lambda x: x.replace(" ", "-")
)


@each_case
def test_variants_free_amplitudes_and_place_shapes_within_bounds(name, scene):
    effect, robot = registry.load("effects", name), scene_of(scene).robot
    known = effect.parameters(robot)
    for v in variants(name, scene):
        assert v.label and v.weight > 0
        assert v.free and set(v.shape) <= set(v.at)
        assert not set(v.free) & set(v.at)
        assert all(known[known.index(n)].nominal == 0.0 for n in v.free)
        effect.values(robot, v.at)
        for n, at in v.at.items():
            assert known[known.index(n)].lower <= at <= known[known.index(n)].upper
        told = effect.publish(robot, v, effect.values(robot, v.at), {})
        assert told and all("value" in item for item in told.values())


@each_case
def test_nothing_happens_at_nominal(name, scene):
    effect, robot = registry.load("effects", name), scene_of(scene).robot
    if not scene_of(scene).jointed and not variants(name, scene):
        return  # needs what this robot's model does not say
    shapes = [{}, *(dict(v.at) for v in variants(name, scene))]
    for at in {tuple(sorted(a.items())): a for a in shapes}.values():
        active = ActiveEffect(effect, effect.values(robot, at))
        assert np.abs(respond(scene_of(scene), [active]) - plain(scene)).max() < 1e-12


@each_case
def test_the_input_is_left_alone(name, scene):
    rows = scene_of(scene)
    poses = [np.asarray(getattr(x, "v", x)) for x in rows.pose]
    arrays = [rows.theta, rows.gravity, rows.joints, rows.t, rows.held, *poses]
    before = [a.copy() for a in arrays]
    for v in variants(name, scene)[-1:]:
        sizes = {n: typical(name, scene, n) for n in v.free}
        change(name, scene, dict(v.at) | sizes)
        effect = registry.load("effects", name)
        if isinstance(effect, base.ReadingEffect):
            reading = plain(scene).copy()
            effect.read(rows, reading, effect.values(rows.robot, dict(v.at) | sizes))
            assert np.array_equal(reading, plain(scene))
    assert all(np.array_equal(a, b) for a, b in zip(arrays, before, strict=True))


@pytest.mark.sampled
@each_case
def test_every_amplitude_is_seen_or_known_to_be_blind(name, scene):
    for n, at in columns(name, scene):
        blind = BLIND.get((scene, n.split(".")[-1]))
        size = np.abs(change(name, scene, at | {n: typical(name, scene, n)})).max()
        assert np.isfinite(size)
        assert blind or size > SEEN, f"{n} at {at}: no reading changes"


@pytest.mark.sampled
@each_case
def test_the_response_is_linear_near_zero(name, scene):
    """``linear = False`` on an effect excepts it: its docstring says why."""
    effect = registry.load("effects", name)
    if not getattr(effect, "linear", True):
        pytest.skip("not linear, by its own word")
    for n, at in columns(name, scene):
        small = 0.02 * typical(name, scene, n)
        once = change(name, scene, at | {n: small})
        twice = change(name, scene, at | {n: 2.0 * small})
        off = np.linalg.norm(twice - 2.0 * once)
        assert off <= 0.1 * np.linalg.norm(twice) + 1e-10, f"{n} at {at}"


@each_effect
def test_what_is_random_is_seeded_and_copies_its_rows(name):
    effect, robot = registry.load("effects", name), registry.load("robots", "ur5")
    t = np.arange(2000) / 125.0
    rows = NOISE * np.random.default_rng(1).standard_normal((len(t), 6))
    before = rows.copy()
    unit = {
        p.name: p.tolerance for p in effect.parameters(robot) if p.nominal == 0.0 and p.upper > 0
    }
    for given in ({}, unit if isinstance(effect, RowEffect) else {}):
        p = effect.values(robot, given)
        first, again = (effect.corrupt(rows, t, p, np.random.default_rng(3)) for _ in range(2))
        assert np.array_equal(first, again)
        assert np.array_equal(rows, before)
        assert first.shape == rows.shape
        if not given:
            assert np.array_equal(first, before)


ROW_EFFECTS = [n for n in NAMES if isinstance(registry.load("effects", n), RowEffect)]


@pytest.mark.parametrize("name", ROW_EFFECTS)
def test_a_row_effect_has_no_mean_and_scatters_or_repeats_rows(name):
    effect, robot = registry.load("effects", name), registry.load("robots", "ur5")
    assert effect.variants(scene_of("ur5 static")) == ()
    t = np.arange(20000) / 125.0
    noise = NOISE * np.random.default_rng(1).standard_normal((len(t), 6))
    load = 10.0 * NOISE * np.sin(0.05 * t)[:, None]
    for p in effect.parameters(robot):
        if p.nominal != 0.0:
            continue
        values = effect.values(robot, {p.name: p.tolerance})
        shown = effect.corrupt(load + noise, t, values, np.random.default_rng(4)) - load
        assert np.abs((shown - noise).mean(axis=0)).max() < 0.02
        repeats = (np.diff(shown + load, axis=0) == 0.0).all(axis=1).mean()
        raised = shown.var(axis=0) / noise.var(axis=0)
        assert raised.max() > 1.2 or repeats > 0.05, p.name


@each_effect
def test_what_is_absurd_is_refused(name):
    effect, robot = registry.load("effects", name), registry.load("robots", "ur5")
    assert effect.title and effect.source and effect.subsystem == name.split(".")[0]
    for p in effect.parameters(robot):
        assert p.lower <= p.nominal <= p.upper and 0.0 < p.tolerance < np.inf
        assert p.unit and p.text, p.name
        with pytest.raises(ParameterError):
            effect.values(robot, {p.name: np.nan})
        for end, beyond in ((p.lower, -np.inf), (p.upper, np.inf)):
            if np.isfinite(end):
                assert effect.values(robot, {p.name: end})[p.name] == end
                with pytest.raises(ParameterError, match="outside"):
                    effect.values(robot, {p.name: np.nextafter(end, beyond)})
