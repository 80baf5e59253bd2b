"""An effect is one file and its two draws: what it declares is complete and holds together.

What `docs/reference/effects.md` prints of each effect is held against the registry there.
"""

import json
from pathlib import Path

import pytest
from effect_scenes import scene_of

from wrenchbed import registry
from wrenchbed.benchmark.fault import EFFECTS
from wrenchbed.benchmark.lookalikes import case as lookalikes
from wrenchbed.benchmark.referee import case as referee
from wrenchbed.effects.base import STAGES, STATED_NUMBERS
from wrenchbed.effects.chain import effects, stated_effects

TRAITS = ("form_error", "size_error", "zero_is_convention", "rough", "local", "once", "channelwise")
DATA = Path(__file__).parents[1] / "data"
WRITTEN = DATA / "effect_traits.json", DATA / "effect_variants.json"
"""Traits of every effect: 6 % of its gap may be missed by all but what jumps, rubs or remembers; a
size is exact where the closed form is (a bias, a mass); what remembers begins at a zero by
convention. Beside them unit, typical size and bounds of its parameters by robot.

Variants by scene and effect: label, free amplitudes, where shapes begin, shape, detail, weight,
rivals, usual amplitudes. `python tests/effects/test_effect_declarations.py` writes both anew."""
ROBOTS = ("ur5", "medrue", "oriented")
SCENES = {
    "ur5 static": [*registry.names("effects")],
    "ur5 motion": ["link.length", "timing.delay", "timing.lowpass", "timing.skew", "tool.inertia"],
    "medrue static": ["cable.torsion", "joint.clearance", "joint.gear_error", "link.length",
                      "sensor.temperature"],
}  # fmt: skip
SHOWN = ("prediction", "time", "load", "loop", "torque", "angle", "matrix")


def test_every_effect_has_two_draws_and_each_stated_number_is_the_error_of_one():
    assert set(lookalikes.DRAWS) == set(referee.DRAWS) == set(EFFECTS) < set(effects())
    # exactly a mass and a CoG: it is in the background of every case; no wrench shows the others
    others = {"tool.self_weight", "drive.constant", "drive.offset"}
    assert set(effects()) - set(EFFECTS) == others
    stated = [e.stated for e in effects().values() if e.stated]
    assert sorted(stated) == sorted(STATED_NUMBERS)
    assert stated_effects() == ("sensor.bias", "tool.mass", "tool.cog")


def test_an_effect_acts_where_it_says():
    """A method of a stage is written exactly where the effect acts at that stage."""
    methods = {
        "model": "theta",
        "joint": "displace",
        "pose": "pose",
        "load": "pull",
        "effort": "sense",
    }
    for effect in effects().values():
        written = {m for c in type(effect).__mro__[:-3] for m in c.__dict__}
        assert list(effect.stages) == [s for s in STAGES if s in effect.stages]
        for stage, method in methods.items():
            assert (method in written) == (stage in effect.stages), f"{effect.name}: {stage}"
        assert ("corrupt" in written) == effect.between_rows
        assert ("read" in written) == effect.in_sensor
        assert effect.shown in SHOWN and "dynamic" in effect.modes


def traits(effect):
    sizes = {
        robot: {p.name: [p.unit, *(float(f"{x:.12g}") for x in (p.tolerance, p.lower, p.upper))]
                for p in effect.parameters(registry.load("robots", robot))}
        for robot in ROBOTS
    }  # fmt: skip
    return {t: getattr(effect, t) for t in TRAITS} | {"sizes": sizes}


@pytest.mark.parametrize("name", registry.names("effects"))
def test_traits_and_typical_sizes_are_those_written_down(name):
    kept = json.loads(WRITTEN[0].read_text(encoding="utf-8"))[name]
    assert json.loads(json.dumps(traits(effects()[name]))) == kept


def ways(name, scene):
    effect = effects()[name]
    return [
        [v.label, [*v.free], dict(v.at), [*v.shape], dict(v.detail), v.weight, [*v.rivals],
         [*effect.usual(v)]]
        for v in effect.variants(scene_of(scene))
    ]  # fmt: skip


def nearly(x):
    """The same with numbers that may differ by rounding."""
    if isinstance(x, dict):
        return {k: nearly(v) for k, v in x.items()}
    return pytest.approx(x, rel=1e-6, abs=1e-9) if isinstance(x, float) else x


@pytest.mark.parametrize("scene", SCENES)
def test_the_ways_of_every_effect_are_those_written_down(scene):
    kept = json.loads(WRITTEN[1].read_text(encoding="utf-8"))[scene]
    assert list(kept) == SCENES[scene]
    for name, before in kept.items():
        now = ways(name, scene)
        assert [w[0] for w in now] == [w[0] for w in before], name
        for found, wanted in zip(now, before, strict=True):
            assert found == [nearly(x) for x in wanted], name


def table(rows):
    return "{\n" + ",\n".join(f'"{n}": {row}' for n, row in rows.items()) + "\n}"


if __name__ == "__main__":
    text = json.JSONEncoder(ensure_ascii=False).encode
    both = (
        {n: text(traits(e)) for n, e in effects().items()},
        {s: table({n: text(ways(n, s)) for n in names}) for s, names in SCENES.items()},
    )
    for path, rows in zip(WRITTEN, both, strict=True):
        path.write_text(table(rows) + "\n", encoding="utf-8")
