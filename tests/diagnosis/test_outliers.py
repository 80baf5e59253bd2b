"""Poses and stretches that all others contradict are set aside, and named with force and place.

A few that have a point and a surface in common are a contact.
"""

from dataclasses import replace

import numpy as np
import pytest

from altered import at_point, with_added, with_columns, with_rows
from simulated import UR5_TRUTH, WHITE, static, with_tool
from wrenchbed import registry
from wrenchbed.benchmark.lookalikes import ExperimentDesign, draw
from wrenchbed.benchmark.lookalikes import recording as look_alike
from wrenchbed.data.holds import runs
from wrenchbed.diagnosis.diagnose import diagnose
from wrenchbed.diagnosis.explain.outliers import Outlier, comes_again
from wrenchbed.diagnosis.prepare import contact
from wrenchbed.diagnosis.prepare.prepare_recording import prepare
from wrenchbed.planning import choose

POSES, ROWS = 60, 10
UR5 = registry.load("robots", "ur5")
LOAD = {k: v for k, v in UR5_TRUTH.items() if k.startswith("tool")}
HAND = np.array([0.0, 0.0, 0.1])
"""Where a hand pushes, sensor axes [m]."""
TIP = np.array([0.0, 0.0, 2.0 * LOAD["tool.cog.z"]])
"""End of the tool, sensor axes [m]."""
ALONG = {"+x": (1.0, 0.0, 0.0), "−y": (0.0, -1.0, 0.0), "+z": (0.0, 0.0, 1.0)}
FRICTION = 0.3


def sound(seed, truth=LOAD, rows=ROWS):
    """A robot as its metadata states it; its bias is stated as 0."""
    rec = static("ur5", truth, poses=POSES, samples=rows, noise=WHITE, seed=seed)
    return with_tool(rec, *LOAD.values())


def pushed(rec, rows, force):
    """The recording with a force (3,) of a hand in some rows (N,)."""
    return with_added(rec, at_point(np.outer(rows, force), HAND))


def in_pose(rec, pose):
    return rec.columns["segment"] == pose


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "pushes"),
    [(0, {7: (20.0, "+x")}), (1, {0: (20.0, "−y")}), (2, {59: (20.0, "+z")}),
     (5, {7: (20.0, "+x"), 41: (4.0, "−y")})],
)  # fmt: skip
def test_poses_of_60_that_are_pushed_are_named_and_the_rest_is_sound(seed, pushes):
    """Also one whose force a larger one hides."""
    rec = hand = sound(seed)
    for pose, (size, along) in pushes.items():
        hand = pushed(hand, in_pose(rec, pose), size * np.array(ALONG[along]))
    found = diagnose(hand)
    told = found.diagnosis
    assert (told.verdict, told.which) == ("none", [])
    assert abs(told.gap.calibrated.value) < 0.3
    assert told.gap.rows == (POSES - len(pushes)) * ROWS
    for outlier, (pose, (size, along)) in zip(told.outliers, pushes.items(), strict=True):
        assert outlier["pose"] == pose
        assert outlier["t"] == pytest.approx(rec.t[in_pose(rec, pose)][[0, -1]])
        assert outlier["sentence"].startswith(f"pose {pose}: {size:g} N along {along} ")
    assert told.to_json()["outliers"] == [dict(o) for o in told.outliers]
    assert found.analysis.prepared.judged.tolist() == [k not in pushes for k in range(POSES)]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_three_poses_at_the_end_of_a_range_are_a_limit_and_no_exceptions(seed):
    """Three of some forty: all others read less than nine tenths of that level."""
    rec = sound(seed)
    size = np.abs([rec.columns["fy"][in_pose(rec, k)].mean() for k in range(POSES)])
    level, largest = 0.9 * size.max(), np.argsort(size)[-3:]
    kept = (size < 0.9 * level) | np.isin(np.arange(POSES), largest)
    rec = with_rows(rec, kept[rec.columns["segment"]])
    clipped = np.clip(rec.columns["fy"], -level, level)
    told = diagnose(with_columns(rec, {"fy": clipped})).diagnosis
    assert told.outliers == []
    (cause,) = told.which
    assert cause["effect"] == "sensor.saturation" and cause["probability"] > 0.9
    assert cause["parameters"]["level.fy"]["value"] == pytest.approx(level, rel=0.01)


@pytest.mark.slow
def test_poses_that_disagree_at_many_times_are_a_fault_of_their_own():
    rec = sound(4)
    rng = np.random.default_rng(4)
    for pose in (3, 14, 26, 39, 52):
        force = 20.0 * rng.standard_normal(3) / np.sqrt(3.0)
        rec = pushed(rec, in_pose(rec, pose), force)
    told = diagnose(rec).diagnosis
    assert len(told.outliers) == 5
    assert told.verdict == "unknown" and told.which == []
    assert any("intermittent fault" in note for note in told.notes)


@pytest.mark.parametrize("channels", [1, 6])
def test_a_jump_that_shows_again_in_what_was_set_aside_comes_and_goes(channels):
    """Of one channel or of all; set aside is what reads as the other level does, or hands."""
    rng = np.random.default_rng(9)
    step = rng.standard_normal(6) * (np.arange(6) < channels)
    on = np.repeat([0.0, 1.0, 0.0], 20)[:, None] * step
    here = np.zeros(60, dtype=bool)

    def aside(errors):
        return [Outlier(here, k, 0.0, 1.0, WHITE * e) for k, e in enumerate(errors)]

    again = [sign * 10.0 * step + 0.3 * rng.standard_normal(6) for sign in (-1.0, 1.0, 1.0)]
    assert comes_again(aside(again), on, WHITE)
    assert not comes_again([], on, WHITE)
    assert not comes_again(aside(again), 0.0 * on, WHITE)
    hands = [aside(20.0 * rng.standard_normal((3, 6))) for _ in range(300)]
    assert sum(comes_again(h, on, WHITE) for h in hands) == 0  # 0.03 expected


@pytest.mark.study  # three quarters of a minute
def test_a_second_of_a_motion_that_is_pushed_is_named():
    design = ExperimentDesign.of_plan(choose.multisine(UR5, 40.0, 125.0, 11), UR5)
    rec = look_alike(design, draw(design, 22, "none"))
    during = (rec.t > 20.0) & (rec.t < 21.0)
    found = diagnose(pushed(rec, during, np.array([0.0, 20.0, 0.0])))
    told = found.diagnosis
    assert told.verdict == "none" and abs(told.gap.excess) < 0.5
    (outlier,) = told.outliers
    assert outlier["pose"] is None
    begin, end = outlier["t"]
    assert 19.2 < begin <= 20.0 and 21.0 <= end < 21.8
    assert "20 N along +y that the rest of the motion does not show" in outlier["sentence"]
    prepared = found.analysis.prepared
    assert np.mean(~prepared.judged) < 2.5 / 40.0  # hardly more than the second
    looked = prepared.excerpt.t  # the longer run without it
    assert (looked[0], looked[-1]) == pytest.approx((rec.t[0], begin), abs=0.05)


@pytest.mark.parametrize(
    ("error", "words"),
    [
        ((20.0, 1.0, -2.0, 0.0, 2.0, 0.0), "20 N along +x"),
        ((0.0, 0.0, -3.0, 0.0, 0.0, 0.0), "3 N along −z"),
        ((6.0, 0.0, -8.0, 0.0, 0.0, 0.0), "10 N along (0.60, 0.00, −0.80)"),
        ((0.1, 0.0, 0.0, 0.0, -0.9, 0.0), "0.9 N·m about −y"),
        ((0.0, 0.0, 0.0, 0.3, 0.4, 0.0), "0.5 N·m about (0.60, 0.80, 0.00)"),
        ((-1e-3, 0.16, -0.465, 0.0, 0.0, 0.0), "0.49 N along (0.00, 0.33, −0.95)"),  # no −0.00
    ],
)
def test_a_force_is_named_with_size_and_direction_a_torque_only_where_no_lever_makes_it(
    error, words
):
    none = np.zeros(3, dtype=bool)
    pose = Outlier(none, 4, 1.0, 2.0, np.array(error)).sentence()
    assert pose == f"pose 4: {words} that no other pose shows: contact, or wrong rows"
    stretch = Outlier(none, None, 1.04, 2.0, np.array(error)).sentence()
    assert stretch.startswith(f"1.0 s to 2.0 s: {words} that the rest of the motion does not show")


@pytest.fixture(scope="module")
def free():
    return sound(8, rows=30)


def poses_of(rec):
    q = rec.q[::30]
    rotation, position = UR5.sensor_pose(q, UR5.parameters.vector(LOAD))
    return rotation, position + rotation @ TIP


def with_forces(rec, world, point):
    """The recording with forces (POSES, 3) in world axes at a point of the tool."""
    force = np.einsum("nij,ni->nj", poses_of(rec)[0], world)
    return with_added(rec, np.repeat(at_point(force, point), 30, axis=0))


def lowest(rec, count):
    """A table under so many poses: its height [m], and how deep each tip is below it."""
    height = poses_of(rec)[1][:, 2]
    level = float(np.mean(np.sort(height)[count - 1 : count + 1]))
    return np.maximum(level - height, 0.0)


@pytest.mark.sampled
@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_table_that_a_few_poses_touch_is_a_contact(free, count):
    deep = lowest(free, count)
    push = 2.0 * np.sqrt(deep / deep.max())  # no law of the library
    world = push[:, None] * np.array([FRICTION, 0.0, 1.0])
    told = diagnose(with_forces(free, world, TIP + np.array([0.004, 0.0, -0.006]))).diagnosis
    assert told.verdict == "identified"
    (cause,) = told.which
    assert cause["effect"] == "environment.contact" and not cause["rivals"]
    assert cause["probability"] > 0.9 if count > 1 else 0.5 < cause["probability"] < 0.9
    for axis, true in zip("xyz", TIP + np.array([0.004, 0.0, -0.006]), strict=True):
        point = cause["parameters"][f"point.{axis}"]
        assert abs(point["value"] - true) < 4.0 * point["std"]
    assert {o["pose"] for o in told.outliers} == set(np.flatnonzero(deep).tolist())
    assert all(o["sentence"].endswith("contact") for o in told.outliers)


def test_a_table_that_a_motion_touches_is_a_contact_though_the_tool_bounces():
    design = ExperimentDesign.of_plan(choose.multisine(UR5, 40.0, 125.0, 11), UR5)
    rec, rng = look_alike(design, draw(design, 22, "none")), np.random.default_rng(3)
    p = prepare(rec)
    rotation, position = UR5.sensor_pose(p.poses, p.theta)
    height = (position + rotation @ p.scene.tip)[:, 2]
    deep = np.maximum(np.quantile(height, 0.08) - height, 0.0)
    push = 1.5 * np.sqrt(deep / deep.max()) * rng.uniform(-1.0, 3.0, len(deep))  # row by row
    touches = [np.isin(np.arange(len(deep)), np.arange(*run)) for run in runs(deep > 0.0)]
    point = 1.05 * p.scene.tip

    def found(ways):
        world = sum(np.outer(push * t, way) for t, way in zip(touches, ways, strict=True))
        force = np.einsum("nij,ni->nj", rotation, world)
        noise = p.sigma * rng.standard_normal(p.y.shape)
        return contact.contact_of(replace(p, y=p.y + at_point(force, point) + noise), touches, p.y)

    upwards = [(FRICTION * rng.uniform(-1.0, 1.0), 0.0, 1.0) for _ in touches]
    touch = found(upwards)
    told = touch.parameters["point.z"]
    assert abs(told["value"] - point[2]) < 4.0 * told["std"]
    assert np.array_equal(touch.rows, deep > 0.0)
    assert found([np.roll(way, k) for k, way in enumerate(upwards)]) is None


@pytest.mark.slow
def test_pushes_without_point_or_way_in_common_are_set_aside_only(free):
    chosen, world = np.flatnonzero(lowest(free, 2)), np.zeros((POSES, 3))
    world[chosen] = (0.0, 0.0, 2.0), (0.0, 2.0, -1.0)
    told = diagnose(with_forces(free, world, -0.5 * TIP)).diagnosis
    assert (told.verdict, told.which) == ("none", [])
    assert {o["pose"] for o in told.outliers} == set(chosen.tolist())
    assert all(o["sentence"].endswith("contact, or wrong rows") for o in told.outliers)
