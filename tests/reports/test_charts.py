"""Figures as data: nothing large is lost, colours and numbers can be read, causes show."""

import json
import math
import re

import numpy as np
import pytest
from test_report import found

from wrenchbed.pages import numbers
from wrenchbed.pages.chart import (
    NOISE,
    Axis,
    Chart,
    Matrix,
    Panel,
    Scale,
    Series,
    extremes,
    luminance,
    readable,
    thinned,
)
from wrenchbed.pages.draw import svg
from wrenchbed.reports.cause_charts import everywhere
from wrenchbed.reports.compared_readings import HeldOutReadings
from wrenchbed.reports.diagnosis_page import _of_causes, diagnosis_page
from wrenchbed.reports.wrench_answer import WrenchAnswer

STIFFNESS = 9000.0


@pytest.fixture(scope="module")
def springy(tmp_path_factory):
    folder = tmp_path_factory.mktemp("springy")
    return diagnosis_page(found(folder, f"joint.compliance:joint=2,stiffness={STIFFNESS:g}"))


def test_one_spike_in_a_million_rows_is_drawn_and_gaps_are_no_extremes():
    y = np.zeros(1_000_000)
    y[123_456], y[654_321] = 7.0, -5.0
    series = Series("measured", "line", np.arange(len(y)) * 1e-3, y)
    (kept,), note = thinned([series])
    assert len(kept.x) <= 400
    assert kept.y.max() == 7.0 and kept.y.min() == -5.0
    assert kept.x[0] == 0.0 and kept.x[-1] == series.x[-1]
    assert re.fullmatch(r"\d+ of 1,000,000 rows drawn: extremes kept\.", note)
    assert thinned([series.at(np.arange(300))])[1] == ""
    y = np.full(5000, np.nan)
    y[1000], y[1001] = 3.0, -3.0
    assert {1000, 1001} <= set(extremes(y, 100).tolist())
    with pytest.raises(ValueError, match="measured.*different lengths"):
        Series("measured", "points", np.zeros(3), np.zeros(4))


@pytest.mark.parametrize("scale", [NOISE, Scale("x", -3.0, 3.0, (0.0,), diverging=True)])
def test_numbers_in_cells_can_be_read_on_every_colour(scale):
    for value in np.linspace(scale.low, scale.high, 200):
        ground = luminance(scale.colour(float(value)))
        ink = luminance(readable(scale.colour(float(value))))
        assert (max(ground, ink) + 0.05) / (min(ground, ink) + 0.05) >= 4.5


def test_still_and_interactive_have_the_same_numbers():
    values = np.array([[0.2, 3.4], [np.nan, 50.0]])
    texts = (("0.2", "3.4"), ("–", "50"))
    matrix = Panel(Axis("x"), Axis(""), matrix=Matrix(("a", "b"), ("c", "d"), values, NOISE, texts))
    told = np.array([1.25, -2.5, 4.0])
    bars = Panel(
        Axis("gap", "1"), Axis("", names=("p", "q", "r")),
        (Series("", "bars", told, np.arange(3)),),
    )  # fmt: skip
    chart = Chart("both", "A <title>", (matrix, bars))
    drawn, data = svg(chart), json.loads(json.dumps(chart.to_json()))
    assert data["panels"][1]["series"][0]["x"] == told.tolist()
    assert data["panels"][0]["matrix"]["values"] == [[0.2, 3.4], [None, 50.0]]
    for text in ("0.2", "3.4", "50", "p", "r", NOISE.label):
        assert f">{text}<" in drawn, text
    assert "<title>A &lt;title&gt;</title>" in drawn and 'role="img"' in drawn


@pytest.mark.slow
def test_a_spring_shows_as_a_line_of_its_stiffness_that_no_fit_drew(springy):
    panel = next(f.chart for f in springy.figures if f.chart.name == "cause-0").panels[0]
    measured = next(s for s in panel.series if s.name == "measured")
    assert panel.x.unit == "N·m" and panel.y.unit == "°"
    weight = 1.0 / measured.std**2
    slope = (weight * measured.x * measured.y).sum() / (weight * measured.x**2).sum()
    sure = 1.0 / np.sqrt((weight * measured.x**2).sum())
    assert abs(np.deg2rad(slope) - 1.0 / STIFFNESS) < 4.0 * np.deg2rad(sure)
    assert sure < 0.1 * slope


@pytest.mark.slow
def test_the_residual_stands_beneath_before_and_after_in_units_of_noise(springy):
    charts = [f.chart for f in springy.figures if f.chart.name.startswith("effect-0")]
    for chart in charts:
        above, beneath = chart.panels
        assert above.x == beneath.x and chart.shared and beneath.y.unit == "noise"
        without, with_it = beneath.series
        assert np.sqrt(np.mean(without.y**2)) > 5 * np.sqrt(np.mean(with_it.y**2))
        assert set(without.ids) == set(next(s for s in above.series if s.name == "measured").ids)
        assert all(s.std is not None for s in above.series if s.name == "measured")


@pytest.mark.slow
def test_crosstalk_is_a_matrix_with_its_own_number_in_its_own_cell(tmp_path):
    told = found(tmp_path, "sensor.crosstalk:x.fx.fy=0.03")
    charts = _of_causes(WrenchAnswer(told), HeldOutReadings(told))
    chart = next(c for c in charts if c.name == "cause-0")
    texts = chart.panels[0].matrix.texts
    assert float(texts[0][1].rstrip(" %")) == pytest.approx(3.0, abs=0.2)
    others = [t for i, row in enumerate(texts) for j, t in enumerate(row) if (i, j) != (0, 1)]
    assert set(others) == {"0"}


@pytest.mark.slow
def test_what_nothing_explains_is_drawn_over_all_that_was_recorded(tmp_path):
    healthy = found(tmp_path)
    chart = everywhere(HeldOutReadings(healthy), "everywhere")
    labels = [p.x.label for p in chart.panels]
    assert labels[:6] == [f"joint {k}" for k in range(1, 7)] and "time" in labels
    assert sum("gravity along" in t for t in labels) == 3
    assert any(t.startswith("simulated load") for t in labels)
    assert all(p.y.unit == "noise" and len(p.series[0].x) == 24 for p in chart.panels)


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


@pytest.mark.parametrize(
    ("si", "unit", "text"),
    [
        (0.0015, "m", "1.5 mm"), (0.4, "m", "400 mm"), (math.pi, "rad", "180°"),
        (0.02, "s", "20 ms"), (2.0, "s", "2 s"), (0.0027, "kg·m²", "2.7 g·m²"),
        (9000.0, "N·m/rad", "9000 N·m/rad"), (0.3, "N·m", "0.3 N·m"), (0.02, "kg", "20 g"),
        (1e-4, "N/s", "0.36 N/h"), (2.5e-5, "m/N", "25 µm/N"), (1e-3, "1/K", "0.1 %/K"),
        (0.005, "N·m", "5 mN·m"), (0.004, "N", "4 mN"), (1.2e-4, "kg·m²", "0.12 g·m²"),
    ],
)  # fmt: skip
def test_people_read_millimetres_and_degrees_and_files_hold_si(si, unit, text):
    assert numbers.quantity("x", {"value": si, "unit": unit}) == text
    assert numbers.quantity("joint", {"value": 4, "rivals": [2, 3]}) == "2, 3 or 4"
    gain = {"value": -0.05, "std": 0.01, "unit": "1"}
    assert numbers.quantity("gain.fx", gain) == "−5.0 ± 1.0 %"


def test_certainty_is_never_claimed():
    assert numbers.chance(1.0) == ">\u00a00.99" and numbers.chance(0.0) == "<\u00a00.01"
    assert numbers.percent(0.954) == "95.4" and numbers.percent(0.99977) == "99.97"
    assert numbers.percent(1 - 1e-9) == "99.9999" and numbers.percent(-1710.0) == "−171,000"
    assert numbers.p_value(1e-30) == "< 0.001" and numbers.minus("+0.0, -0.02") == "0.0, −0.02"
    assert numbers.gap(-0.01) == numbers.gap(-0.0) == "0.00" and numbers.gap(1234.5) == "1,234"
