"""What effects are built from: parameters, variants, one joint's values, and the chain's order."""

from types import SimpleNamespace

import numpy as np
import pytest

from wrenchbed.effects import base, chain
from wrenchbed.effects.chain import ActiveEffect
from wrenchbed.errors import ParameterError

SCENE = SimpleNamespace(mode="dynamic", averaged=False)
"""Rows of a motion, as far as the chain asks."""


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
