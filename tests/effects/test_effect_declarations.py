"""An effect is one file and its two draws: what it declares is complete and holds together."""

from wrenchbed.benchmark.lookalikes.catalogue import EFFECTS as LOOKALIKES
from wrenchbed.benchmark.referee.catalogue import EFFECTS as REFEREE
from wrenchbed.effects.base import STAGES, STATED_NUMBERS, ChannelEffect
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
