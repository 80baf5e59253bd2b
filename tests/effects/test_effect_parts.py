"""What effects are built from: parameters, variants, one joint's values, and the chain's order."""

from types import SimpleNamespace

import numpy as np
import pytest

from wrenchbed import registry
from wrenchbed.effects import base, chain
from wrenchbed.effects.chain import ActiveEffect
from wrenchbed.errors import ParameterError
from wrenchbed.physics.wrench import CHANNELS, UNITS

SCENE = SimpleNamespace(mode="dynamic", averaged=False)
"""Rows of a motion, as far as the chain asks."""


def joint(unit):
    return SimpleNamespace(unit=unit)


def test_channels_have_sizes_of_forces_and_torques():
    told = base.channel_parameters("bias", 0.5, 0.02, "text")
    assert [p.name for p in told] == [f"bias.{c}" for c in CHANNELS]
    assert [p.tolerance for p in told] == [0.5, 0.5, 0.5, 0.02, 0.02, 0.02]
    assert [p.unit for p in told] == list(UNITS)
    assert {(p.nominal, p.lower, p.upper) for p in told} == {(0.0, -1e4, 1e4)}
    other = base.channel_parameters("gain", 0.5, 0.02, "text", ["1"] * 6)
    assert {p.unit for p in other} == {"1"}


def test_channels_show_alone_by_kind_or_all_together():
    told = base.channel_variants("bias", {"tau": 3.0}, ("tau",))
    names = [f"bias.{c}" for c in CHANNELS]
    assert [v.free for v in told[:6]] == [(n,) for n in names]
    assert [v.detail for v in told[:6]] == [{"channel": c} for c in CHANNELS]
    assert [v.free for v in told[6:]] == [tuple(names[:3]), tuple(names[3:]), tuple(names)]
    assert [v.weight for v in told] == [1, 1, 1, 1, 1, 1, 2, 1, 3]
    assert all(dict(v.at) == {"tau": 3.0} and v.shape == ("tau",) for v in told)
    assert dict(base.channel_variants("bias")[0].at) == {}


def test_joints_have_sizes_of_their_kind():
    robot = SimpleNamespace(joints=[joint("rad"), joint("m")])
    told = base.joint_parameters(robot, "offset", 0.01, 0.002, "text", ("rad", "m"))
    assert [(p.name, p.tolerance, p.unit) for p in told] == [
        ("offset.q1", 0.01, "rad"),
        ("offset.q2", 0.002, "m"),
    ]
    assert {(p.nominal, p.lower, p.upper) for p in told} == {(0.0, -1e3, 1e3)}


def test_joints_show_alone_or_all_together_where_there_are_any():
    effect = registry.load("effects", "joint.offset")
    scene = SimpleNamespace(jointed=True, robot=SimpleNamespace(joints=[joint("rad")] * 2))
    told = effect.variants(scene)
    assert [v.free for v in told] == [("offset.q1",), ("offset.q2",), ("offset.q1", "offset.q2")]
    assert [v.detail for v in told] == [{"joint": 1}, {"joint": 2}, {}]
    assert [v.weight for v in told] == [1.0, 1.0, 2.0]
    scene.jointed = False
    assert effect.variants(scene) == ()


def test_one_joint_is_named_by_its_number():
    names = ("offset.q1", "offset.q2", "offset.q6", "other")
    given = {"joint": 2, "offset": 0.1, "other": 5}
    assert base.of_joint(given, names, 6) == {"offset.q2": 0.1, "other": 5}
    assert given == {"joint": 2, "offset": 0.1, "other": 5}
    assert base.of_joint({"joint": 6.0, "offset": 1}, names, 6) == {"offset.q6": 1}
    assert base.of_joint({"offset.q1": 2}, names, 6) == {"offset.q1": 2}
    assert base.of_joint({"joint": 1}, ("gain.fx",), 6) == {"joint": 1}
    for number in (0, 7, 1.5):
        with pytest.raises(ParameterError, match="does not exist: 1 … 6"):
            base.of_joint({"joint": number}, names, 6)
    with pytest.raises(ParameterError, match="is no number"):
        base.of_joint({"joint": "two"}, names, 6)


def reading(stage, change):
    class Some(base.ReadingEffect):
        name, title, source = "sensor.some", "", ""

        def parameters(self, robot):
            raise NotImplementedError

        def variants(self, scene):
            raise NotImplementedError

        def read(self, scene, value, p):
            return change(value)

    Some.stage = stage
    return ActiveEffect(Some(), {})


def test_readings_change_before_timing_whatever_the_order():
    late = reading("timing", lambda r: r + 1.0)
    twice, half = reading("reading", lambda r: 2.0 * r), reading("reading", lambda r: r - 0.5)
    for active in ([late, twice], [twice, late]):
        assert chain.EffectChain(active).read(SCENE, np.array([3.0])) == pytest.approx([7.0])
    assert chain.EffectChain([twice, half]).read(SCENE, np.array([3.0])) == pytest.approx([5.5])
    assert chain.EffectChain([half, twice]).read(SCENE, np.array([3.0])) == pytest.approx([5.0])


@pytest.mark.parametrize(
    ("modes", "moving", "averaged", "expected"),
    [
        (("static",), False, False, True),
        (("static",), True, False, False),
        (("dynamic",), True, False, True),
        (("dynamic",), False, False, False),
        (("dynamic",), False, True, True),
        (("static",), False, True, True),
    ],
)
def test_an_effect_acts_in_its_modes_and_in_averages_of_a_motion(modes, moving, averaged, expected):
    mode = "dynamic" if moving else "static"
    effect = reading("reading", lambda r: r).effect
    effect.modes = modes
    assert effect.acts(SimpleNamespace(mode=mode, averaged=averaged)) is expected


def test_only_a_changed_load_leaves_the_sensor_in_its_place():
    robot = SimpleNamespace(parameters=SimpleNamespace(names=("mass", "length")), load={"mass"})
    scene = SimpleNamespace(theta=np.array([1.0, 2.0]), robot=robot)
    assert chain._only_load(scene, np.array([1.0, 2.0]))
    assert chain._only_load(scene, np.array([1.5, 2.0]))
    assert not chain._only_load(scene, np.array([1.0, 2.5]))
    assert not chain._only_load(scene, np.array([1.5, 2.5]))
