"""An effect is one file and its two draws: what it declares is complete and holds together."""

import pytest

from wrenchbed.benchmark.lookalikes.catalogue import EFFECTS as LOOKALIKES
from wrenchbed.benchmark.referee.catalogue import EFFECTS as REFEREE
from wrenchbed.effects.base import SHOWN, STAGES, STATED_NUMBERS, ChannelEffect
from wrenchbed.effects.chain import effects, stated_effects


def undrawn(known):
    """Effects without a draw or a reason, or with both, in each catalogue of the benchmark."""
    return [
        f"{name}: {kind}"
        for name, effect in known.items()
        for kind, catalogue, reason in (
            ("look-alike", LOOKALIKES, effect.no_lookalike),
            ("referee", REFEREE, effect.no_referee),
        )
        if (name in catalogue) == bool(reason)
    ]


class Dummy(ChannelEffect):
    """y_i → y_i."""

    name = "sensor.dummy"
    title = "nothing happens"
    source = "estimate"
    stem, sizes, text = "size", (1.0, 1.0), "of nothing"

    def read(self, scene, reading, p):
        return reading


class Excused(Dummy):
    """The same with reasons."""

    no_lookalike = no_referee = "it does nothing"


def test_every_effect_has_both_draws_or_says_why_not():
    assert undrawn(effects()) == []


def test_a_new_effect_without_draws_is_detected():
    new = {"sensor.dummy": Dummy()}
    assert undrawn(new) == ["sensor.dummy: look-alike", "sensor.dummy: referee"]
    assert undrawn({"sensor.dummy": Excused()}) == []
    assert undrawn({"sensor.gain": Excused()}) != []  # a reason beside a draw is out of date


def test_every_draw_is_of_an_effect():
    assert set(LOOKALIKES) | set(REFEREE) <= set(effects())


def test_each_stated_number_is_the_error_of_one_effect():
    stated = [e.stated for e in effects().values() if e.stated]
    assert sorted(stated) == sorted(STATED_NUMBERS)
    assert stated_effects() == ("sensor.bias", "tool.mass", "tool.cog")
    assert {e.hidden_by for e in effects().values()} - {""} <= set(STATED_NUMBERS)


def test_companions_are_other_effects():
    for name, effect in effects().items():
        assert set(effect.companions) <= set(effects()) - {name}


def test_an_effect_acts_where_it_says():
    """A method of a stage is written exactly where the effect acts at that stage."""
    methods = {"model": "theta", "joint": "displace", "pose": "pose", "load": "pull"}
    for effect in effects().values():
        assert list(effect.stages) == [s for s in STAGES if s in effect.stages]
        for stage, method in methods.items():
            written = any(method in c.__dict__ for c in type(effect).__mro__[:-3])
            assert written == (stage in effect.stages), f"{effect.name}: {stage}"
        assert ("corrupt" in type(effect).__dict__) == effect.between_rows
        assert ("read" in type(effect).__dict__) == effect.in_sensor


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


def test_how_nearly_right_a_closed_form_is():
    unsure = {name: size for size, names in SIZE.items() for name in names.split()}
    for name, effect in effects().items():
        assert effect.form_error == FORM.get(name, 0.06), name
        assert effect.size_error == unsure.get(name, 0.0), name


FLAGS = {
    "zero_is_convention": "cable.pull cable.torsion environment.contact sensor.creep sensor.drift "
    "sensor.hysteresis sensor.jump sensor.nonlinearity sensor.temperature tool.leak tool.slide",
    "rough": "cable.pull environment.contact sensor.jump tool.loose",
    "external": "cable.pull cable.torsion environment.contact",
    "local": "joint.backlash joint.clearance joint.compliance joint.gear_error joint.offset "
    "link.length",
    "all_channels": "timing.stale",
    "beside_sensor": "cable.torsion",
    "hidden_by": "tool.self_weight",
    "companions": "mount.rotation",
}
"""Of which effects a remark holds; what remembers, for instance, begins at a zero by convention."""


@pytest.mark.parametrize("flag", FLAGS)
def test_a_remark_is_made_of_the_effects_that_it_is_true_of(flag):
    assert {n for n, e in effects().items() if getattr(e, flag)} == set(FLAGS[flag].split())


OWN_FIGURE = {
    "time": "sensor.creep sensor.drift sensor.jump sensor.temperature tool.leak tool.slide",
    "load": "sensor.gain sensor.nonlinearity sensor.saturation",
    "loop": "sensor.hysteresis",
    "torque": "joint.backlash joint.compliance",
    "angle": "joint.gear_error joint.offset",
    "matrix": "sensor.crosstalk",
    "depth": "environment.contact",
    "lag": "timing.delay timing.lowpass timing.skew",
}
"""What an effect's own figure in a report is drawn over; all others by what they predict."""


def test_every_effect_is_drawn_over_what_shows_it():
    own = {name: over for over, names in OWN_FIGURE.items() for name in names.split()}
    assert {n: e.shown for n, e in effects().items()} == {
        n: own.get(n, "prediction") for n in effects()
    }
    assert set(OWN_FIGURE) | {"prediction"} == set(SHOWN)


def test_only_backlash_jumps_between_two_places_of_a_joint():
    assert [n for n, e in effects().items() if not e.smooth] == ["joint.backlash"]


def test_only_timing_and_inertia_need_a_motion():
    dynamic = {n for n, e in effects().items() if "static" not in e.modes}
    assert dynamic == {"timing.delay", "timing.lowpass", "timing.skew", "tool.inertia"}
    assert all("dynamic" in e.modes for e in effects().values())
