"""An effect is one file and its two draws: what it declares is complete and holds together.

What `docs/reference/effects.md` prints of each effect is held against the registry there.
"""

import json
from pathlib import Path

from wrenchbed.benchmark.frame import EFFECTS
from wrenchbed.benchmark.lookalikes import imperfection as lookalikes
from wrenchbed.benchmark.referee import catalogue as referee
from wrenchbed.effects.base import SHOWN, STAGES, STATED_NUMBERS
from wrenchbed.effects.chain import effects, stated_effects

TRAITS = ("form_error", "size_error", "zero_is_convention", "rough", "local", "once", "channelwise")
DECLARED = Path(__file__).parents[1] / "data" / "effect_traits.json"
"""Traits of every effect: 6 % of its gap may be missed by all but what jumps, rubs or remembers; a
size is exact where the closed form is (a bias, a mass); what remembers begins at a zero by
convention."""


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


def test_traits_are_those_written_down():
    told = {n: {t: getattr(e, t) for t in TRAITS} for n, e in effects().items()}
    assert told == json.loads(DECLARED.read_text(encoding="utf-8"))
