"""Forms that are no formula: what the referee makes, and that their effect is named."""

import numpy as np
import pytest

from wrenchbed.benchmark.referee.forms import FORMS, LEAST, make_form
from wrenchbed.benchmark.referee.memory import by_convolution, play, preisach, two_speeds
from wrenchbed.diagnosis.diagnose import diagnose


def test_eight_forms_of_each_effect():
    assert {e: len(forms) for e, forms in FORMS.items()} == dict.fromkeys(
        ("sensor.drift", "sensor.creep", "sensor.hysteresis", "sensor.nonlinearity"), 8
    )


def test_a_convolution_with_one_relaxation_is_its_step_response():
    t = np.linspace(0.0, 100.0, 4001)
    y = np.where(t[:, None] < 10.0, [[1.0, -2.0]], [[3.0, 1.0]])
    late = by_convolution(t, y, lambda s: -np.expm1(-s / 20.0))
    exact = np.where(t[:, None] < 10.0, 0.0, -np.expm1(-(t[:, None] - 10.0) / 20.0))
    assert np.abs(late - exact * [2.0, 3.0])[t > 10.2].max() < 0.02


def test_a_lag_of_two_speeds_rises_fast_and_falls_slowly():
    t = np.linspace(0.0, 40.0, 4001)
    y = np.where((t > 1.0) & (t < 20.0), 1.0, 0.0)[:, None]
    late = two_speeds(t, y, 2.0, 8.0)[:, 0]
    assert np.interp(3.0, t, late) == pytest.approx(1.0 - np.exp(-1.0), abs=0.01)
    assert np.interp(28.0, t, late) == pytest.approx(np.exp(-1.0), abs=0.01)


def test_loops_close_and_turn_round():
    x = 0.9 * np.sin(np.linspace(0.0, 4.0 * np.pi, 2001))[:, None]
    for lag in (x - play(x, 0.2), preisach(x, 0.5, 0.3)):
        assert np.allclose(lag[1500:2000], lag[500:1000], atol=0.02)
        up, down = lag[1100, 0], lag[1400, 0]
        assert up > 0.02 > -0.02 > down


@pytest.mark.parametrize(
    ("effect", "form"),
    [
        ("sensor.drift", "daily_wave"),
        ("sensor.creep", "logarithm"),
        ("sensor.hysteresis", "dahl_friction"),
        ("sensor.nonlinearity", "wave"),
    ],
)
def test_a_form_without_a_formula_has_the_name_of_its_effect(effect, form):
    case = make_form("ur5", "static", effect, form, 101)
    assert case.causes[0].gap >= LEAST
    found = diagnose(case.recording).diagnosis
    assert found.which[0]["effect"] == effect
    assert found.which[0].get("form") == "free"
    curve = found.which[0]["curve"]
    assert len(curve["x"]) == len(curve["y"]) == len(curve["std"])
    assert np.isfinite([*curve["x"], *curve["y"], *curve["std"]]).all()
