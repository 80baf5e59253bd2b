"""Rows of a scene, the stages of the chain, effects by name, channels one by one."""

from types import SimpleNamespace

import numpy as np
import pytest
from effect_scenes import NAMES, SCENES, columns, motion, plain, scene_of

from wrenchbed import registry
from wrenchbed.channels.readings_with_effects import Response, Responses
from wrenchbed.channels.wrench import CHANNEL as WRENCH
from wrenchbed.effects.base import Effect
from wrenchbed.effects.chain import ActiveEffect, EffectChain, active_effect, effects, respond
from wrenchbed.effects.scene import Scene, examples, held_on
from wrenchbed.errors import NotFoundError, ParameterError
from wrenchbed.physics.taylor_jets import Jet
from wrenchbed.physics.wrench import CHANNELS

UR5 = registry.load("robots", "ur5")


def rows(q, t):
    gravity, held = np.array(UR5.gravity), np.ones(len(t), dtype=bool)
    return Scene(UR5, UR5.parameters.nominal, gravity, q, np.asarray(t, dtype=float), held)


def test_rows_are_a_motion_if_they_carry_velocities_and_accelerations():
    assert not scene_of("oriented static").jointed
    t = np.arange(200) / 100.0
    q = np.zeros((200, 6))
    scene = rows(Jet(q, q, q), 3.0 + t)
    x = np.stack([t**2, 5.0 * t], axis=1)
    jet = scene.in_motion(x)
    assert np.array_equal(jet.v, x)
    inside = slice(2, -2)
    assert jet.d[inside] == pytest.approx(np.stack([2.0 * t, 5.0 + 0.0 * t], axis=1)[inside])
    assert jet.dd[inside] == pytest.approx(np.tile([2.0, 0.0], (200, 1))[inside], abs=1e-9)
    assert scene.in_motion(jet) is jet
    assert rows(q, t).in_motion(x) is x
    assert (scene.mode, rows(q, t).mode) == ("dynamic", "static")


def test_a_joint_comes_from_the_side_on_which_it_last_moved():
    """In radians a row; 1e-5 rad is no step."""
    q = np.zeros((7, 6))
    q[:, 0] = [0.0, 0.0, 1e-3, 1e-3, 2e-3, 1e-3, 1.005e-3]
    q[:, 1] = [0.0, -3e-5, -3e-5, -6e-5, -3.1e-5, -3.1e-5, 5.0]
    scene = rows(q, np.arange(7.0))
    assert scene.coming[:, 0].tolist() == [0, 0, 1, 1, 1, -1, -1]
    assert scene.coming[:, 1].tolist() == [0, -1, -1, -1, 1, 1, 1]
    assert not scene.coming[:, 2:].any()
    speed = np.zeros((4, 6))
    speed[:, 0] = [0.5e-4, 2e-4, -0.5e-4, -2e-4]  # below 1e-4 rad/s it stands
    assert rows(Jet(q[:4], speed, speed), np.arange(4.0)).coming[:, 0].tolist() == [0, 1, 1, -1]
    sign = np.array([[0.0, 1.0], [1.0, 0.0], [0.0, -1.0], [-1.0, 0.0], [0.0, 0.0]])
    held = [[0.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, -1.0]]
    assert held_on(sign).tolist() == held


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("name", registry.names("effects"))
def test_what_is_published_can_be_read_back(name, scene):
    effect, at = effects()[name], scene_of(scene)
    for variant in effect.variants(at)[:12]:
        known = effect.parameters(at.robot)
        size = {n: known[known.index(n)].tolerance for n in variant.free}
        values = effect.values(at.robot, dict(variant.at) | size)
        std = {n: 0.1 * x for n, x in size.items()}
        back = effect.amplitudes(effect.publish(at.robot, variant, values, std))
        for n in variant.free:
            assert back[n]["value"] == pytest.approx(values[n])
            assert back[n]["std"] == pytest.approx(std[n])
        for n in variant.shape:
            assert back[n]["value"] == values[n] and back[n]["std"] is None


def test_stages_act_in_their_order_whatever_the_order_given():
    """A gain acts on all that pulls, weight of a heavier tool and cable; a zero is not scaled."""
    scene = scene_of("ur5 static")
    names = ["sensor.bias", "sensor.gain", "cable.pull", "tool.mass"]
    given = {
        "sensor.bias": {"bias.fx": 1.0}, "sensor.gain": {"gain.fx": 0.1},
        "cable.pull": {"pull.x": 2.0, "pull.z": 1.0}, "tool.mass": {"mass": 0.5},
    }  # fmt: skip

    def told(*order):
        chosen = [ActiveEffect.of(scene.robot, n, given[n]) for n in order]
        return respond(scene, chosen)

    load = told("cable.pull") + told("tool.mass") - plain("ur5 static")
    expected = load * [1.1, 1, 1, 1, 1, 1] + [1.0, 0, 0, 0, 0, 0]
    assert told("sensor.gain", "sensor.bias", "tool.mass", "cable.pull") == pytest.approx(expected)
    assert told("cable.pull", "sensor.gain", "tool.mass", "sensor.bias") == pytest.approx(expected)
    zero_first = told(*names) - told("sensor.gain", "sensor.bias", "cable.pull", "tool.mass")
    assert zero_first[:, 0] == pytest.approx(0.1)  # of one stage the order is that given


def test_displacements_add_up_and_only_smooth_ones_have_velocities():
    scene = scene_of("ur5 static")
    offset, gear = (
        ActiveEffect.of(scene.robot, n, v)
        for n, v in (
            ("joint.offset", {"joint": 2, "offset": 0.01}),
            ("joint.gear_error", {"joint": 2, "cos": 1e-3, "order": 1.0}),
        )
    )
    moved = EffectChain([offset, gear]).displacement(scene)
    assert moved[:, 1] == pytest.approx(0.01 + 1e-3 * np.cos(scene.joints[:, 1]))
    assert EffectChain([]).displacement(scene) == 0.0
    scene = motion("ur5", seconds=2.0)
    give = ActiveEffect.of(scene.robot, "joint.compliance", {"joint": 2, "stiffness": 1e4})
    moved = EffectChain([give]).displacement(scene)
    assert isinstance(moved, Jet)
    rate = np.gradient(scene.joint_torque[:, 1] / 1e4, 1.0 / 125.0)
    assert moved.d[:, 1] == pytest.approx(rate, abs=1e-9)
    jump = ActiveEffect.of(scene.robot, "joint.backlash", {"joint": 2, "load": 1e-3})
    assert not isinstance(EffectChain([jump]).displacement(scene), Jet)


def test_what_shows_only_in_motion_does_not_act_at_rest():
    effect = effects()["timing.delay"]
    assert not effect.acts(SimpleNamespace(mode="static", averaged=False))
    assert effect.acts(SimpleNamespace(mode="dynamic", averaged=False))
    assert effect.acts(SimpleNamespace(mode="static", averaged=True))  # averages of a motion
    assert effects()["sensor.bias"].acts(SimpleNamespace(mode="static", averaged=True))
    still = scene_of("ur5 static")
    late = ActiveEffect.of(still.robot, "timing.delay", {"delay": 0.5})
    assert np.array_equal(EffectChain([late]).read(still, still.load), still.load)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("joint.offset:joint=3", {"offset.q3": np.deg2rad(0.2)}),
        ("joint.offset", {f"offset.q{k}": np.deg2rad(0.2) for k in range(1, 7)}),
        ("joint.offset:joint=3,offset=0.01", {"offset.q3": 0.01}),
        ("joint.backlash:joint=2,side=approach", {"approach.q2": 2e-4}),
        ("sensor.gain:channel=fz", {"gain.fz": 0.01}),
        ("sensor.hysteresis:channel=tx", {"middle.tx": 0.01, "width": 1.0}),
        ("tool.cog", {f"cog.{a}": 2e-3 for a in "xyz"}),
        ("tool.cog:axis=y", {"cog.y": 2e-3}),
        ("tool.cog: cog.x = 1e-3 , cog.z=-2e-3", {"cog.x": 1e-3, "cog.z": -2e-3}),
        ("timing.lowpass:order=2", {"tau": 0.01, "stages": 2.0}),
        ("timing.stale", {"share": 0.1}),
        ("base.vibration:amplitude.fx=0.5", {"amplitude.fx": 0.5, "frequency": 12.0}),
        ("tool.mass:", {"mass": 0.027}),
    ],
)
def test_an_effect_by_its_text_has_these_values_and_no_other(text, expected):
    told = active_effect(UR5, text)
    assert told.effect.name == text.split(":")[0]
    assert {n: v for n, v in told.values.items() if v} == pytest.approx(expected)


@pytest.mark.parametrize(
    ("text", "error", "says"),
    [
        ("joint.offset:joint=9", ParameterError, "does not exist: 1 … 6"),
        ("joint.offset:joint=1.5", ParameterError, "does not exist: 1 … 6"),
        ("joint.offset:joint=two", ParameterError, "is no number"),
        ("tool.cog:axis=w", ParameterError, "axis"),
        ("joint.compliance:jont=2", ParameterError, "no parameter 'jont'.* first: joint, "),
        (
            "joint.offset:joint=3,ofset=0.01",
            ParameterError,
            "no parameter 'ofset'.* first: offset, ",
        ),
        ("joint.compliance:stifness=9000", ParameterError, "'stifness'.* first: stiffness, "),
        ("joint.compliance:stiffness=9000", ParameterError, "stiffness .*joint=1 … 6"),
        ("tool.cog:=2", ParameterError, "is not name=value"),
        ("tool.cog:cog.x", ParameterError, "'cog.x' is not name=value"),
        ("tool.cog:cog.x=1,cog.x=1", ParameterError, "'cog.x' is given twice"),
        ("tool.cog:cog.x=5", ParameterError, "outside"),
        ("tool.cgo", NotFoundError, "tool.cog"),
    ],
)
def test_a_text_that_says_nothing_possible_is_refused(text, error, says):
    with pytest.raises(error, match=says):
        active_effect(UR5, text)


@pytest.mark.sampled
@pytest.mark.parametrize("robot", ["ur5", "medrue"])
@pytest.mark.parametrize("mode", ["static", "dynamic"])
def test_small_errors_of_joints_act_by_the_slopes_of_the_readings(robot, mode):
    """The full chain's central differences, whose third order is what remains."""
    loaded = registry.load("robots", robot)
    (scene,) = (s for s in examples(loaded) if s.mode == mode and s.jointed)
    response = Response(scene, (WRENCH,))
    checked = 0
    for effect in effects().values():
        if effect.stages != ("joint",) or not effect.acts(scene):
            continue
        known = {p.name: p for p in effect.parameters(loaded)}
        for v in (*effect.variants(scene), *effect.free_forms(scene)):
            start = {n: p.nominal for n, p in known.items()} | dict(v.at)
            half = {n: 0.5 * known[n].tolerance for n in v.free}
            for n, h in half.items():
                up, down = (respond(scene, [ActiveEffect(effect, start | {n: x})]) for x in (h, -h))
                told = response.tangent(effect, known[n], v)
                assert told == pytest.approx(up - down, abs=1e-6 + 2e-4 * np.abs(told).max())
                checked += 1
    assert checked > 20


def amplitudes(name: str, scene: str) -> dict[tuple, list[str]]:
    """Names of amplitudes that end with a channel, by the shape that they have."""
    found: dict[tuple, list[str]] = {}
    for amplitude, at in columns(name, scene):
        if amplitude.rpartition(".")[2] in CHANNELS:
            found.setdefault(tuple(sorted(at.items())), []).append(amplitude)
    return found


EVERY = [(name, scene) for name in NAMES for scene in SCENES if amplitudes(name, scene)]
CASES = [(name, scene) for name, scene in EVERY if registry.load("effects", name).channelwise]


def slope(effect: Effect, label: str, at: dict, amplitude: str) -> np.ndarray:
    """Change of the readings (M, 6) per typical size of one amplitude, by the whole chain."""
    scene = scene_of(label)
    known = effect.parameters(scene.robot)
    size = known[known.index(amplitude)].tolerance
    ends = [
        respond(
            scene, [ActiveEffect(effect, effect.values(scene.robot, at | {amplitude: half * size}))]
        )
        for half in (0.5, -0.5)
    ]
    return ends[0] - ends[1]


def test_one_effect_of_channels_is_not_channelwise():
    assert len({name for name, _ in CASES}) >= 8
    assert {name for name, _ in EVERY} - {name for name, _ in CASES} == {"sensor.crosstalk"}


@pytest.mark.parametrize("name, scene", EVERY, ids=str)
def test_changed_together_they_are_what_each_is_alone(name, scene):
    effect, rows = registry.load("effects", name), scene_of(scene)
    known = effect.parameters(rows.robot)
    for shape, names in amplitudes(name, scene).items():
        found = Response(rows, (WRENCH,)).changes(
            effect, [known[known.index(n)] for n in names], dict(shape)
        )
        for group, change in found:
            assert len(group) == 1 or effect.channelwise
            for amplitude in group:
                own = [CHANNELS.index(amplitude.rpartition(".")[2])]
                some = own if len(group) > 1 else slice(None)
                alone = slope(effect, scene, dict(shape), amplitude)[:, some]
                size = max(np.abs(alone).max(), 1e-9)
                assert np.abs(change[:, some] - alone).max() < 1e-9 * size + 1e-12, amplitude


SOME = ("joint.offset", "cable.pull", "sensor.gain", "tool.mass", "base.tilt", "joint.compliance")


def sets(scene, count=30):
    """Sets of effects whose numbers change a few at a time."""
    rng, robot = np.random.default_rng(2), scene.robot
    effects = [e for n in SOME if (e := registry.load("effects", n)).variants(scene)]
    values = {e.name: e.values(robot, {}) for e in effects}
    for _ in range(count):
        changed = effects[rng.integers(len(effects))]
        names = [p for p in changed.parameters(robot) if p.nominal == 0.0]
        p = names[rng.integers(len(names))]
        size = rng.choice([0.0, 0.5, 1.0]) * p.tolerance
        values[changed.name] = {**values[changed.name], p.name: size}
        some = [e for e in effects if rng.random() < 0.7]
        yield [ActiveEffect(e, values[e.name]) for e in some]


def responses(scene):
    poses = int(scene.held.sum())
    return Responses(scene, (WRENCH,), np.zeros((poses, 6)), np.zeros(poses, dtype=bool))


@pytest.mark.parametrize("label", SCENES)
def test_readings_are_those_of_each_set_alone(label):
    scene = scene_of(label)
    kept = responses(scene)
    for active in sets(scene):
        assert np.array_equal(kept.of(active), respond(scene, active), equal_nan=True)
