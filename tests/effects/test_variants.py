"""In which ways an effect may show: what is free, where shapes begin, what counts how much."""

from collections import Counter
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from effect_scenes import scene_of, variants
from wrenchbed import registry
from wrenchbed.physics.rotations import apply
from wrenchbed.physics.wrench import CHANNELS, wrench

FORCES, TORQUES = CHANNELS[:3], CHANNELS[3:]
CHANNEL_WAYS = {
    **{c: ([c], 1) for c in CHANNELS},
    "forces": (FORCES, 2),
    "torques": (TORQUES, 1),
    "all channels": (CHANNELS, 3),
}
"""One channel, all forces, all torques, all: an error of all is three times as likely as of one."""
JOINTS = {f"joint {k}": ([f"q{k}"], 1) for k in range(1, 7)} | {
    "all joints": ([f"q{k}" for k in range(1, 7)], 2)
}


def stem(ways, before):
    return {
        label: ([f"{before}.{n}" for n in names], weight) for label, (names, weight) in ways.items()
    }


WAYS = {
    "base.compliance": {
        "alike about x and y": (["compliance"], 2),
        "about x": (["compliance.x"], 1),
        "about y": (["compliance.y"], 1),
        "about x and y": (["compliance.x", "compliance.y"], 1),
    },
    "base.tilt": {"about x and y": (["x", "y"], 1)},
    "cable.torsion": {
        "twists": (["stiffness"], 1),
        "rubs": (["friction"], 1),
        "twists and rubs": (["stiffness", "friction"], 1),
    },
    "joint.backlash": {
        f"{label}, side by {side}": way
        for side in ("load", "approach")
        for label, way in stem(JOINTS, side).items()
    },
    "joint.clearance": {"last bearing": (["tilt"], 1)},
    "joint.compliance": stem(JOINTS, "compliance"),
    "joint.offset": stem(JOINTS, "offset"),
    "mount.rotation": {
        "about x, y and z": (["rotation.x", "rotation.y", "rotation.z"], 1),
        "about z": (["rotation.z"], 1),
        "about x and y": (["rotation.x", "rotation.y"], 1),
    },
    "sensor.bias": stem(CHANNEL_WAYS, "bias"),
    "sensor.crosstalk": {
        f"{a} from {b}": ([f"x.{a}.{b}"], 1) for a, b in product(CHANNELS, CHANNELS) if a != b
    }
    | {
        f"{a} from {b}": ([f"x.{i}.{j}" for i in group[a] for j in group[b] if i != j], 1)
        for group in ({"forces": FORCES, "torques": TORQUES},)
        for a, b in product(group, group)
    }
    | {
        "shifted origin": (["origin.x", "origin.y", "origin.z"], 1),
        "everything": ([f"x.{a}.{b}" for a, b in product(CHANNELS, CHANNELS) if a != b], 1),
    },
    "sensor.drift": stem(CHANNEL_WAYS, "rate")
    | {
        f"warm-up in {long} of the recording, {label}": way
        for long in ("0.25", "1", "4")
        for label, way in (
            stem({k: w for k, w in CHANNEL_WAYS.items() if len(w[0]) != 3}, "warm")
            | {
                "span": (["warm.span"], 1),
                "span of each channel": ([f"warm.span.{c}" for c in CHANNELS], 1),
                **{
                    f"{c} and all spans": (
                        [f"warm.{c}", *(f"warm.span.{d}" for d in CHANNELS)],
                        0.5,
                    )
                    for c in CHANNELS
                },
                "zero and span": (
                    [n for c in CHANNELS for n in (f"warm.{c}", f"warm.span.{c}")],
                    2,
                ),
            }
        ).items()
    },
    "sensor.gain": stem(CHANNEL_WAYS, "gain"),
    "sensor.hysteresis": {
        label + moves: (
            [f"{w}{s}.{c}" for c in names for w in PLAYS for s in ("", ".slope")],
            weight,
        )
        for PLAYS in (("narrow", "middle", "wide"),)
        for label, (names, weight) in CHANNEL_WAYS.items()
        for moves in ("", ", brisk moves")
    },
    "tool.cog": {
        "x, y and z": (["cog.x", "cog.y", "cog.z"], 3),
        **{a: ([f"cog.{a}"], 1) for a in "xyz"},
    },
    "tool.flexure": {
        **{f"along {a}": ([f"compliance.{a}"], 1) for a in "xyz"},
        "along x and y": (["compliance.x", "compliance.y"], 2),
        "bends": (["bending"], 2),
        "along any way": ([f"compliance.{a}" for a in ("x", "y", "xy", "xz", "yz")], 2),
    },
    "tool.leak": {
        "steady": (["rate"], 1),
        "any course": (["rate", *(f"wave.{k}" for k in range(1, 6))], 1),
    },
    "tool.mass": {"mass": (["mass"], 1)},
    "tool.self_weight": {"mass": (["mass"], 1)},
    "tool.slide": {
        **{f"steady along {a}": ([f"rate.{a}"], 1) for a in "xyz"},
        "steady": ([f"rate.{a}" for a in "xyz"], 3),
        **{
            f"any course along {a}": ([f"rate.{a}", *(f"wave.{a}.{k}" for k in range(1, 6))], 1)
            for a in "xyz"
        },
        "any course": (
            [n for a in "xyz" for n in (f"rate.{a}", *(f"wave.{a}.{k}" for k in range(1, 6)))],
            3,
        ),
    },
}
"""Label → free amplitudes and how likely against the others, of poses of a UR5."""
INERTIAS = ["inertia.xx", "inertia.yy", "inertia.zz", "inertia.xy", "inertia.xz", "inertia.yz"]
IN_MOTION = {
    "timing.delay": {"late readings": (["delay"], 1)},
    "timing.lowpass": {"first order": (["tau"], 1), "second order": (["tau"], 1)},
    "timing.skew": {"clock": (["skew"], 1), "channels in turn": (["channel"], 1)},
    "tool.inertia": {
        "all six": (INERTIAS, 3),
        "moments about x, y and z": (INERTIAS[:3], 2),
        **{n[-2:]: ([n], 1) for n in INERTIAS},
    },
}
TWISTS = [f"twist.{k}" for k in range(1, 7)]
LENGTHS = ["length.a2", "length.a3", "length.d4", "length.d5", "length.d6"]
TWIST_WAYS = {f"alpha{k}": ([n], 1) for k, n in enumerate(TWISTS, 1)} | {"all twists": (TWISTS, 2)}
LOOPS = [
    *(f"length.L{i}{k}" for i in (1, 2) for k in (1, 2, 3, 4)),
    *(f"length.{a}{i}{y}" for a in "AC" for i in (1, 2) for y in "yz"),
    "length.d41",
    "length.d42",
]
LINKS = {
    "ur5 static": TWIST_WAYS,
    # a length that is zero in the design has no amplitude; d1 only lifts the arm
    "ur5 motion": TWIST_WAYS
    | {n.removeprefix("length."): ([n], 1) for n in LENGTHS}
    | {"all lengths": (LENGTHS, 1)},
    "medrue static": {n.removeprefix("length."): ([n], 1) for n in LOOPS}
    | {"all links": (LOOPS[:8], 2), "all lengths": (LOOPS, 1)},
}
CASES = (
    [("ur5 static", name, ways) for name, ways in WAYS.items()]
    + [("ur5 motion", name, ways) for name, ways in IN_MOTION.items()]
    + [(scene, "link.length", ways) for scene, ways in LINKS.items()]
    + [
        ("medrue static", "joint.clearance", {
            "tips": (["play.1"], 1),
            **{f"link L{k}": ([f"slack.L{k}"], 1) for k in (12, 14, 22, 24)},
            "links of five-bar 1": (["slack.L12", "slack.L14"], 1),
            "links of five-bar 2": (["slack.L22", "slack.L24"], 1),
            "links of both five-bars": ([f"slack.L{k}" for k in (12, 14, 22, 24)], 1),
        }),
        ("medrue static", "cable.torsion", {
            text + where: way
            for text, way in WAYS["cable.torsion"].items()
            for where in ("", " about the last joint")
        }),
    ]
)  # fmt: skip


def prior(weights):
    """Shares that add up to 1."""
    total = sum(weights.values())
    return {key: weight / total for key, weight in weights.items()}


@pytest.mark.parametrize(("scene", "name", "ways"), CASES, ids=lambda x: x if str(x) == x else "")
def test_what_is_free_and_how_likely_it_is(scene, name, ways):
    found = registry.load("effects", name).variants(scene_of(scene))
    assert {v.label: sorted(v.free) for v in found} == {k: sorted(n) for k, (n, _) in ways.items()}
    assert len(found) == len(ways)
    told = prior({v.label: v.weight for v in found})
    assert told == pytest.approx(prior({label: weight for label, (_, weight) in ways.items()}))


@pytest.mark.parametrize(
    ("scene", "name", "free", "detail"),
    [
        ("ur5 static", "joint.backlash", "approach.q3", {"joint": 3, "side": "approach"}),
        ("ur5 static", "sensor.hysteresis", "wide.slope.tx", {"channel": "tx"}),
        ("ur5 static", "sensor.crosstalk", "x.tz.fy", {"channel": "tz", "of": "fy"}),
        ("ur5 static", "sensor.creep", "share.fz", {"channel": "fz"}),
        ("ur5 static", "sensor.nonlinearity", "odd.ty", {"law": "odd", "channel": "ty"}),
        ("ur5 static", "sensor.saturation", "share.tz", {"channel": "tz"}),
        ("medrue static", "sensor.temperature", "zero.fy", {"channel": "fy"}),
        ("ur5 static", "link.length", "twist.2", {"parameter": "alpha2"}),
        ("ur5 motion", "link.length", "length.d4", {"parameter": "d4"}),
        ("ur5 motion", "tool.inertia", "inertia.xz", {"axes": "xz"}),
        ("ur5 static", "tool.cog", "cog.y", {"axis": "y"}),
        ("ur5 static", "tool.flexure", "compliance.z", {"axis": "z"}),
        ("ur5 static", "tool.slide", "rate.y", {"axis": "y"}),
        ("ur5 static", "tool.slide", "wave.x.2", {"axis": "x", "form": "free"}),
    ],
)
def test_an_amplitude_alone_is_told_by_what_it_is_of(scene, name, free, detail):
    found = [v for v in variants(name, scene) if free in v.free]
    fewest = min(len(v.free) for v in found)
    alone = [v for v in found if len(v.free) == fewest]
    assert all(dict(v.detail) == detail for v in alone)
    which = set(detail) - {"side", "law"}
    together = [v for v in found if v.label.split(", ")[-1].startswith("all ")]
    assert not any(which & set(v.detail) for v in together)


@pytest.mark.parametrize(("label", "order"), [("first order", 1), ("second order", 2)])
def test_filters_are_of_one_stage_or_of_two(label, order):
    (found,) = (v for v in variants("timing.lowpass", "ur5 motion") if v.label == label)
    assert dict(found.at) == {"stages": float(order)}
    assert dict(found.detail) == {"order": order}
    assert found.shape == ()


@pytest.mark.parametrize("name", ["tool.leak", "tool.slide"])
def test_a_free_course_lasts_as_long_as_the_recording(name):
    free = [v for v in variants(name, "ur5 static") if v.label.startswith("any course")]
    assert {v.at["duration"] for v in free} == {59 * 5.0}  # 60 poses, 5 s apart
    assert {v.detail["form"] for v in free} == {"free"}
    assert not any("duration" in v.shape for v in free)


def test_a_cable_is_twisted_about_the_sensors_z_or_where_that_differs_the_last_joint():
    for scene in ("ur5 static", "medrue static"):
        for v in variants("cable.torsion", scene):
            about = float("last joint" in v.label)
            assert dict(v.at) == {"joint_axis": about, "neutral": 0.0}
            assert v.shape == ("neutral",)


def test_creep_begins_at_minutes_settled_early_or_late():
    found = variants("sensor.creep", "ur5 static")
    starts = {(v.at["tau"], v.at["late"]) for v in found}
    assert starts == set(product((30.0, 150.0, 600.0), (0.0, 1.0)))
    for start in starts:
        own = [v for v in found if (v.at["tau"], v.at["late"]) == start]
        assert {v.label: v.weight for v in own} == {k: w for k, (_, w) in CHANNEL_WAYS.items()}
        assert {v.shape for v in own} == {("tau",)}


@pytest.mark.parametrize(
    ("text", "law", "power"), [("even", "even", 2), ("odd", "odd", 3), ("gain by sign", "even", 1)]
)
def test_a_bent_characteristic_is_even_odd_or_differs_between_push_and_pull(text, law, power):
    every = variants("sensor.nonlinearity", "ur5 static")
    found = {v.label.split(", ")[1]: v for v in every if v.label.split(", ")[0] == text}
    assert len(every) == 27
    assert {k: v.weight for k, v in found.items()} == {k: w for k, (_, w) in CHANNEL_WAYS.items()}
    for label, v in found.items():
        assert set(v.free) == {f"{law}.{c}" for c in CHANNEL_WAYS[label][0]}
        assert dict(v.at) == {"power": power}
        assert v.shape == ("power",)
        assert v.detail["law"] == text


def test_a_temperature_acts_at_once_or_late_and_only_where_it_is_recorded():
    assert variants("sensor.temperature", "ur5 static") == ()
    recorded = variants("sensor.temperature", "medrue static")
    assert Counter((tuple(v.at.items()), v.shape) for v in recorded) == {
        ((), ()): 16,
        ((("lag", 20.0),), ("lag",)): 16,
    }
    for at in (recorded[:16], recorded[16:]):
        likely = Counter()
        for v in at:
            likely[tuple(sorted({n.split(".")[0] for n in v.free}))] += v.weight
        # the zero alone 9, all spans or one 2, one channel with all spans 3, all of both 2
        assert prior(likely) == pytest.approx(
            {("zero",): 9 / 16, ("span",): 2 / 16, ("span", "zero"): 5 / 16}
        )
        assert {v.weight for v in at if v.label.endswith("and all spans")} == {0.5}
        assert sorted(at[-1].free) == sorted(f"{k}.{c}" for k in ("zero", "span") for c in CHANNELS)


def test_waves_of_gears_are_of_the_encoder_or_of_the_wave_generator():
    found = variants("joint.gear_error", "ur5 static")
    assert Counter(v.at["order"] for v in found) == dict.fromkeys((1, 2, 3, 4, 101, 202), 6)
    assert {(v.free, v.detail["joint"]) for v in found} == {
        ((f"sin.q{k}", f"cos.q{k}"), k) for k in range(1, 7)
    }
    assert {v.shape for v in found} == {("order",)}
    assert found[0].label == "joint 1, 1 wave a turn"
    assert found[5].label == "joint 1, 202 waves a turn"
    turning = variants("joint.gear_error", "medrue static")  # its first joint slides, no gears told
    assert {v.detail["joint"] for v in turning} == {2, 3, 4, 5, 6}
    assert {v.at["order"] for v in turning} == {1, 2, 3, 4}


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


def test_a_jump_is_of_the_forces_or_of_all_channels():
    found = variants("sensor.jump", "ur5 static")
    by_label = Counter((v.label, tuple(sorted(v.free)), v.shape, v.weight) for v in found)
    assert by_label == {
        ("forces", tuple(f"step.{c}" for c in FORCES), ("time",), 1.0): 24,
        ("all channels", tuple(sorted(f"step.{c}" for c in CHANNELS)), ("time",), 1.0): 24,
    }
    at = np.unique([v.at["time"] for v in found])
    assert np.ptp(np.diff(at)) <= 5.0 + 1e-9  # evenly: moments lie 5 s apart
    assert at[0] - 10.0 == pytest.approx(10.0 + 5.0 * 59 - at[-1], abs=5.0)


def test_a_loose_part_begins_along_axes_and_diagonals():
    found = variants("tool.loose", "ur5 static")
    for text, grip, shape in (
        ("falls", 0.0, ("way.x", "way.y", "way.z", "lean")),
        ("sticks", 0.3, ("way.x", "way.y", "way.z", "lean", "grip")),
    ):
        own = [v for v in found if v.label.startswith(text)]
        ways = np.array([[v.at[f"way.{a}"] for a in "xyz"] for v in own])
        assert np.linalg.norm(ways, axis=1) == pytest.approx(1.0)
        # 13 lines through the centre of a cube: no two of them along one line
        assert len(own) == 13
        assert np.abs(ways @ ways.T - np.eye(13)).max() < 0.9
        assert np.abs(ways).max(axis=1).min() == pytest.approx(3**-0.5)
        for v in own:
            assert (v.free, v.shape) == (("shift",), shape)
            assert (v.at["lean"], v.at["grip"]) == (0.0, grip)
    labels = {v.label: tuple(v.at[f"way.{a}"] for a in "xyz") for v in found}
    assert labels["falls along +1x-1y"] == pytest.approx((0.5**0.5, -(0.5**0.5), 0.0))


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
