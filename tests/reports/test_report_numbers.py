"""Numbers of a report: as many digits as are known, with their unit."""

import math

import pytest

from wrenchbed.pages import numbers


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (1.4e4, 600.0, "(1.40 ± 0.06)·10⁴"),
        (0.0108, 0.0002, "0.01080 ± 0.00020"),
        (-16.548, 0.214, "−16.55 ± 0.21"),
        (-1e-9, 0.5, "0.0 ± 0.5"),
        (3.0, None, "3"),
        (float("nan"), 1.0, "–"),
    ],
)
def test_a_value_has_as_many_digits_as_are_known(value, std, text):
    assert numbers.measured(value, std) == text


def test_values_have_a_unit_that_people_read():
    told = {"value": 0.006, "std": 0.0001, "unit": "rad"}
    assert numbers.quantity("x", told) == "0.344 ± 0.006°"
    assert numbers.quantity("gain.fx", {"value": -0.05, "std": 0.01, "unit": "1"}) == "−5.0 ± 1.0 %"
    assert numbers.quantity("joint", {"value": 2, "rivals": [3]}) == "2 (or 3)"


@pytest.mark.parametrize(
    ("si", "unit", "text"),
    [
        (0.0015, "m", "1.5 mm"), (0.4, "m", "400 mm"), (math.pi, "rad", "180°"),
        (0.02, "s", "20 ms"), (2.0, "s", "2 s"), (0.0027, "kg·m²", "2.7 g·m²"),
        (9000.0, "N·m/rad", "9000 N·m/rad"), (0.3, "N·m", "0.3 N·m"),
    ],
)  # fmt: skip
def test_people_read_millimetres_and_degrees_and_files_hold_si(si, unit, text):
    assert numbers.quantity("x", {"value": si, "unit": unit}) == text
    shown, factor = numbers.HUMAN.get(unit, (unit, 1.0))
    assert (
        unit == "s" and si < 0.1
    ) or f"{factor * si:g}{'' if shown == '°' else ' '}{shown}" == text


def test_certainty_is_never_claimed():
    assert numbers.chance(1.0) == ">\u00a00.99" and numbers.chance(0.0) == "<\u00a00.01"
    assert numbers.percent(0.954) == "95.4" and numbers.percent(0.99977) == "99.97"
    assert numbers.percent(1 - 1e-9) == "99.9999" and numbers.percent(-1710.0) == "−171,000"
    assert numbers.p_value(1e-30) == "< 0.001"
