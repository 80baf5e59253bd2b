"""Curves that are no formula of the library: the effect is named all the same, its form is free."""

import numpy as np
import pytest

from wrenchbed.benchmark.frame import elapsed, named
from wrenchbed.benchmark.referee.case import as_case, robot_with_minor
from wrenchbed.benchmark.referee.fault import BEND, LOOP, ZERO, RefereeFault, touched
from wrenchbed.benchmark.referee.laws import dahl
from wrenchbed.diagnosis.diagnose import diagnose


def daily_wave(setting, rng, size):
    """A zero that follows a part of a sine."""
    curve = np.sin(2.0 * np.pi * (rng.uniform(0.4, 2.0) * elapsed(setting.path.t) + rng.uniform()))
    shift = np.outer(curve, 3e-3 * size * setting.full_scale * touched(rng))
    return RefereeFault(change=lambda ride, y: y + shift, stage=ZERO)


def dahl_friction(setting, rng, size):
    """A reading that lags by dry friction."""
    width = 1.5e-3 * size * setting.full_scale * np.abs(touched(rng))
    reach = rng.uniform(0.05, 0.3)

    def gauge(ride, y):
        loops = np.stack([dahl(c, reach) for c in (y / setting.swing).T], axis=1)
        return y - width * loops

    return RefereeFault(change=gauge, stage=LOOP)


def wave(setting, rng, size):
    """A converter's integral nonlinearity, less its straight line, which would be a gain."""
    turns, phase = rng.uniform(2.5, 6.0), rng.uniform(0.0, 2.0 * np.pi)
    bend = 2e-3 * size * setting.full_scale * touched(rng)
    usual = setting.nominal / setting.swing
    lines = np.stack([np.polyfit(u, np.sin(turns * u + phase), 1) for u in usual.T])

    def gauge(ride, y):
        u = y / setting.swing
        return y + bend * (np.sin(turns * u + phase) - lines[:, 0] * u - lines[:, 1])

    return RefereeFault(change=gauge, stage=BEND)


FORMS = {
    "sensor.drift": daily_wave,
    "sensor.hysteresis": dahl_friction,
    "sensor.nonlinearity": wave,
}


@pytest.mark.sampled
@pytest.mark.parametrize("effect", FORMS)
def test_a_form_without_a_formula_has_the_name_of_its_effect(effect):
    seed = (101, list(FORMS).index(effect))
    rng = np.random.default_rng([*seed, 7])
    world, minor = robot_with_minor("ur5", "static", seed, rng)
    draw, size = named(effect, FORMS[effect]), 1.0
    for _ in range(3):  # to a gap of 15
        cause = world.measured(draw(world.setting, np.random.default_rng(seed), size))
        size *= float(np.sqrt(15.0 / cause.gap))
    assert cause.gap > 5.0
    found = diagnose(as_case("single", world, [cause], minor, rng).recording).diagnosis
    assert found.which[0]["effect"] == effect
    if effect == "sensor.hysteresis":  # a formula's loop comes near enough to dry friction's
        return
    assert found.which[0].get("form") == "free"
    curve = found.which[0]["curve"]
    assert len(curve["x"]) == len(curve["y"]) == len(curve["std"])
    assert np.isfinite([*curve["x"], *curve["y"], *curve["std"]]).all()
