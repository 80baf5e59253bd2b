"""Look-alike cases: faults that show, a background that does not, and physics of their own."""

from functools import cache

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from wrenchbed import registry
from wrenchbed.benchmark.fault import between
from wrenchbed.benchmark.lookalikes import ExperimentDesign, draw, effects, families, recording
from wrenchbed.benchmark.lookalikes.motion_loads import in_motion
from wrenchbed.errors import ParameterError
from wrenchbed.physics.taylor_jets import Jet
from wrenchbed.physics.wrench import wrench
from wrenchbed.planning.choose import multisine, poses
from wrenchbed.robots.oriented import ROBOT as ORIENTED

MOTION_ONLY = {"tool.inertia", "timing.delay", "timing.lowpass", "timing.stale", "timing.skew"}


def made(kind):
    name, mode = kind.split()
    robot = registry.load("robots", name)
    plan = multisine(robot, 12.0, 125.0, 1) if mode == "dynamic" else poses(robot, 60, 3)
    return ExperimentDesign.of_plan(plan, robot)


design_of = cache(made)
each_design = pytest.mark.parametrize("kind", ["ur5 static", "ur5 dynamic", "medrue static"])


def shows(case, effect, needed=1.0, rows=0.5):
    if between(effect):
        return case.rows[effect] >= rows
    return case.gaps[effect] >= needed


@pytest.mark.sampled
@each_design
def test_every_effect_of_a_design_can_be_drawn_and_shows(kind):
    design = design_of(kind)
    known = effects(design)
    assert len(known) >= 24
    assert (set(known) & MOTION_ONLY == MOTION_ONLY) == design.moving
    for effect in known:
        case = draw(design, 11, "single", effect)
        assert case.causes == (effect,) and case.kind == "single" and case.outside is None
        assert shows(case, effect), effect
        assert case.clean.shape == design.nominal.shape and np.isfinite(case.clean).all()
        assert np.isfinite([*case.true_parameters(effect).values()] or [np.nan]).all()


@pytest.mark.sampled
@each_design
def test_the_same_seed_gives_the_same_case_bit_for_bit(kind):
    one, two = design_of(kind), made(kind)
    for case_kind in ("single", "pair", "outside"):
        a, b = draw(one, 4, case_kind), draw(two, 4, case_kind)
        assert a.causes == b.causes and a.outside == b.outside and a.gaps == b.gaps
        assert all(a.true_parameters(e) == b.true_parameters(e) for e in a.causes)
        np.testing.assert_array_equal(a.clean, b.clean)
    np.testing.assert_array_equal(recording(one, a).wrench, recording(two, b).wrench)


@pytest.mark.sampled
@each_design
def test_the_background_alone_is_no_gap(kind):
    design = design_of(kind)
    count = 3 if design.moving else 40
    for seed in range(count):
        case = draw(design, seed, "none")
        assert case.causes == () and case.gaps == {}
        r = ((case.clean - design.nominal) / design.noise_std).ravel()
        left = r - design.usual.basis @ (design.usual.basis.T @ r)
        assert 0.01 < left @ left / len(r) < 0.5


@pytest.mark.sampled
@each_design
def test_pairs_are_two_causes_of_different_subsystems_that_both_show(kind):
    design = design_of(kind)
    for seed in range(2 if design.moving else 8):
        case = draw(design, seed, "pair")
        first, second = case.causes
        assert first.split(".")[0] != second.split(".")[0]
        assert shows(case, first, 1.5, 0.75) and shows(case, second, 1.5, 0.75)


@pytest.mark.sampled
@each_design
def test_families_outside_the_library_show(kind):
    design = design_of(kind)
    known = families(design)
    assert len(known) >= 10
    for name in known:
        case = draw(design, 5, "outside", name)
        assert case.causes == () and case.outside == name and case.gaps[name] >= 2.0


@pytest.mark.parametrize("name", ["ur5", "medrue"])
def test_at_rest_the_nominal_case_is_the_closed_form(name):
    design = design_of(f"{name} static")
    rotation, position = design.robot.sensor_pose(design.q, design.theta)
    tool = design.robot.tool(design.theta)
    expected = wrench(rotation, position, tool, design.gravity)
    np.testing.assert_allclose(design.nominal, expected, atol=1e-9, rtol=0.0)


def test_in_motion_the_nominal_case_is_newton_and_euler():
    design = design_of("ur5 dynamic")
    step = 1.0 / 125.0
    speed = np.gradient(design.q, step, axis=0, edge_order=2)
    way = CubicSpline(design.t, design.q)
    jet = Jet(design.q, way(design.t, 1), way(design.t, 2))
    assert np.abs(speed - jet.d).max() < 0.05
    pose = design.robot.sensor_pose(jet, design.theta)
    expected = wrench(*pose, design.robot.tool(design.theta), design.gravity)
    np.testing.assert_allclose(design.nominal[2:-2], expected[2:-2], atol=2e-3)


@pytest.mark.parametrize("kind", ["ur5 static", "medrue static"])
def test_rows_scatter_about_the_clean_reading_as_stated(kind):
    design = design_of(kind)
    case = draw(design, 2, "single", "sensor.gain")
    rows = recording(design, case)
    assert len(rows) == len(design) * design.samples
    hold = rows.wrench.reshape(len(design), design.samples, 6)
    spread = ((hold.mean(axis=1) - case.clean) / design.noise_std).std(axis=0)
    assert (spread < 0.8).all()
    own = (hold - hold.mean(axis=1, keepdims=True)).std(axis=(0, 1)) / design.noise_std
    assert (np.abs(own - 1.0) < 0.2).all()


def test_a_recording_gives_its_design_back():
    design = design_of("ur5 static")
    again = ExperimentDesign.of(recording(design, draw(design, 0, "none")))
    assert len(again) == len(design) and again.samples == design.samples
    np.testing.assert_allclose(again.q, design.q, atol=1e-4)
    np.testing.assert_allclose(again.t - again.t[0], design.t - design.t[0], atol=1e-2)
    assert "sensor.gain" in effects(again)
    design = design_of("ur5 dynamic")
    again = ExperimentDesign.of(recording(design, draw(design, 0, "none")))
    np.testing.assert_allclose(again.nominal, design.nominal, atol=0.01)


def test_rows_between_holds_show_what_only_rows_can():
    design = design_of("ur5 static")
    coarse = draw(design, 3, "single", "sensor.quantization")
    rows = recording(design, coarse).wrench
    steps = coarse.true_parameters("sensor.quantization")
    k = max(steps, key=steps.get)
    step, column = steps[k], "fx fy fz tx ty tz".split().index(k)
    np.testing.assert_allclose(rows[:, column] / step, np.round(rows[:, column] / step), atol=1e-6)
    clipped = draw(design, 3, "single", "sensor.saturation")
    for name, limit in clipped.true_parameters("sensor.saturation").items():
        column = "fx fy fz tx ty tz".split().index(name)
        top = np.abs(recording(design, clipped).wrench[:, column]).max()
        assert top <= limit * (1.0 + 1e-9)


def test_orientations_alone_are_a_design():
    rng = np.random.default_rng(0)
    q = ORIENTED.sample(40, rng)
    seed = design_of("ur5 static")
    design = ExperimentDesign(
        ORIENTED, "static", q, 4.0 * np.arange(40.0), 20, 100.0, seed.metadata, seed.noise_std,
        20.0 + 8.0 * np.linspace(0.0, 1.0, 40),
    )  # fmt: skip
    known = effects(design)
    assert "sensor.gain" in known and not any(e.startswith("joint.") for e in known)
    for effect in known:
        assert shows(draw(design, 1, "single", effect), effect)
    rows = recording(design, draw(design, 0))
    assert rows.joints == () and "temperature" in rows.columns


def test_what_a_design_cannot_show_is_refused():
    design = design_of("ur5 static")
    with pytest.raises(ParameterError, match="shows no 'sensor.temperature'"):
        draw(design, 0, "single", "sensor.temperature")
    with pytest.raises(ParameterError, match="shows no 'timing.delay'"):
        draw(design, 0, "single", "timing.delay")
    with pytest.raises(ParameterError, match="kind of case"):
        draw(design, 0, "triple")


def test_a_motion_by_orientations_alone_can_be_tilted():
    t = np.arange(50) / 100.0
    turn = Rotation.from_rotvec(np.outer(t, [0.0, 1.0, 0.0]))
    q = turn.as_quat(scalar_first=True)
    motion = in_motion(ORIENTED, ORIENTED.parameters.nominal, t, q, np.array([0.0, 0.0, -9.81]))
    tilted = motion.tilted(np.array([0.1, 0.0, 0.0]))
    wanted = (turn.inv() * Rotation.from_rotvec([-0.1, 0.0, 0.0])).apply([0.0, 0.0, -9.81])
    assert np.abs(tilted.specific_force - wanted).max() < 1e-6
