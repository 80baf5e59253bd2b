"""An effect is one file and its two draws: what it declares is complete and holds together.

What `docs/reference/effects.md` prints of each effect is held against the registry there.
"""

import pytest

from wrenchbed.benchmark.frame import EFFECTS
from wrenchbed.benchmark.lookalikes import imperfection as lookalikes
from wrenchbed.benchmark.referee import catalogue as referee
from wrenchbed.effects.base import SHOWN, STAGES, STATED_NUMBERS
from wrenchbed.effects.chain import effects, stated_effects

FORM = {
    "environment.contact": 0.20, "tool.loose": 0.20, "sensor.hysteresis": 0.45,
    "joint.backlash": 0.15, "sensor.creep": 0.15, "cable.torsion": 0.10, "sensor.saturation": 0.10,
}  # fmt: skip
"""Share of its gap that a closed form may miss: 6 % of all but what jumps, rubs or remembers."""
SIZE = {
    0.20: "sensor.hysteresis",
    0.15: "environment.contact joint.backlash joint.clearance sensor.creep",
    0.10: "base.compliance cable.pull cable.torsion joint.compliance joint.gear_error sensor.drift "
    "sensor.nonlinearity sensor.temperature tool.flexure tool.leak tool.loose "
    "tool.slide",
    0.05: "timing.lowpass",
    0.02: "sensor.saturation",
}
"""Relative standard uncertainty of a size; none where the closed form is exact: a bias, a mass."""
FLAGS = {
    "zero_is_convention": "cable.pull cable.torsion environment.contact sensor.creep sensor.drift "
    "sensor.hysteresis sensor.jump sensor.nonlinearity sensor.temperature tool.leak tool.slide",
    "rough": "cable.pull environment.contact sensor.jump tool.loose",
    "local": "joint.backlash joint.clearance joint.compliance joint.gear_error joint.offset "
    "link.length",
    "once": "sensor.drift sensor.jump",
}
"""Of which effects a remark holds; what remembers, for instance, begins at a zero by convention."""


def test_every_effect_has_a_draw_in_both_catalogues():
    assert set(lookalikes.DRAWS) == set(referee.DRAWS) == set(EFFECTS) < set(effects())
    # exactly a mass and a CoG: it is in the background of every case
    assert set(effects()) - set(EFFECTS) == {"tool.self_weight"}


def test_each_stated_number_is_the_error_of_one_effect():
    stated = [e.stated for e in effects().values() if e.stated]
    assert sorted(stated) == sorted(STATED_NUMBERS)
    assert stated_effects() == ("sensor.bias", "tool.mass", "tool.cog")


def test_an_effect_acts_where_it_says():
    """A method of a stage is written exactly where the effect acts at that stage."""
    methods = {"model": "theta", "joint": "displace", "pose": "pose", "load": "pull"}
    for effect in effects().values():
        written = {m for c in type(effect).__mro__[:-3] for m in c.__dict__}
        assert list(effect.stages) == [s for s in STAGES if s in effect.stages]
        for stage, method in methods.items():
            assert (method in written) == (stage in effect.stages), f"{effect.name}: {stage}"
        assert ("corrupt" in written) == effect.between_rows
        assert ("read" in written) == effect.in_sensor
        assert effect.shown in SHOWN and "dynamic" in effect.modes


def test_how_nearly_right_a_closed_form_is():
    unsure = {name: size for size, names in SIZE.items() for name in names.split()}
    for name, effect in effects().items():
        assert effect.form_error == FORM.get(name, 0.06), name
        assert effect.size_error == unsure.get(name, 0.0), name


@pytest.mark.parametrize("flag", FLAGS)
def test_a_remark_is_made_of_the_effects_that_it_is_true_of(flag):
    assert {n for n, e in effects().items() if getattr(e, flag)} == set(FLAGS[flag].split())
