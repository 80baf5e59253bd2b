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


def test_intervals_have_the_unit_of_their_value():
    told = {"value": 0.006, "std": 0.0001, "unit": "rad"}
    assert numbers.quantity("x", told) == "6.00 ± 0.10 mrad"
    assert numbers.interval("x", told) == "5.80 … 6.20 mrad"
    assert numbers.degrees(told) == f"{math.degrees(0.006):.3g}°"
    assert numbers.quantity("gain.fx", {"value": -0.05, "std": 0.01, "unit": "1"}) == "−5.0 ± 1.0 %"
    assert numbers.quantity("joint", {"value": 2, "rivals": [3]}) == "2 (or 3)"
    assert numbers.interval("x", {"value": 1.0, "std": None, "unit": "N"}) == "–"


def test_certainty_is_never_claimed():
    assert numbers.chance(1.0) == ">\u00a00.99" and numbers.chance(0.0) == "<\u00a00.01"
    assert numbers.percent(0.954) == "95.4" and numbers.percent(0.99977) == "99.97"
    assert numbers.percent(1 - 1e-9) == "99.9999" and numbers.percent(-1710.0) == "−171,000"
    assert numbers.p_value(1e-30) == "< 0.001"
