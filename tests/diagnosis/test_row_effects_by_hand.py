"""What shows between rows, from scatters and repeats whose numbers are stated."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import ndtr

from wrenchbed.diagnosis.between_rows import row_effects
from wrenchbed.diagnosis.between_rows.row_effects import RowFinding
from wrenchbed.diagnosis.prepare.repeated_rows import Repeats, Step
from wrenchbed.physics.wrench import CHANNELS

ALL = (0, 1, 2, 3, 4, 5)
ONES = np.ones(6)


def scatter(variance=ONES, std=0.01, stated=True, scale=2.0, steady=True):
    """Scatter of known variance (6,) in units of its scale."""
    return SimpleNamespace(
        variance=lambda: (variance * ONES, std * ONES),
        scale=scale * ONES,
        stated=stated,
        rows=np.zeros((40, 6)),
        steady=lambda _: np.full(6, steady),
    )


def recording(mode="static", noise=None, n=10):
    """Readings that rise by 1 a row."""
    metadata = SimpleNamespace(mode=mode, sensor=SimpleNamespace(noise_std=noise))
    rows = np.arange(float(n))
    return SimpleNamespace(metadata=metadata, t=0.1 * rows, wrench=np.outer(rows, ONES))


def repeats(share, expected=0.0, std=0.005, channels=ALL, stale=None):
    stale = np.zeros(10, dtype=bool) if stale is None else stale
    return Repeats(stale, share, std, expected, 2.0, channels)


@pytest.fixture(autouse=True)
def no_line(monkeypatch):
    monkeypatch.setattr(row_effects, "line", lambda *_: None)


@pytest.mark.parametrize(("rise", "told"), [(0.44, False), (0.46, True)])
def test_a_coarse_count_is_told_from_a_rise_of_0_45(rise, told):
    steps = [Step(0.2, 0.001), None, None, Step(0.3, 0.002), None, None]
    counted = np.array([0.46, 0, 0, rise, 0, 0]) * 4.0
    found = row_effects._coarse(steps, counted, 4.0 * ONES)
    assert found.effect == "sensor.quantization"
    assert found.channels == (("fx", "tx") if told else ("fx",))
    assert found.rise == pytest.approx(0.46)
    assert found.probability == pytest.approx(0.99 * ndtr(0.01 / 0.02))
    assert found.parameters["step.fx"] == {"value": 0.2, "std": 0.001, "unit": "N"}
    assert row_effects._coarse(steps, counted * 0.9, 4.0 * ONES) is None


def test_repeats_are_told_from_a_share_of_three_hundredths():
    rec = recording()
    assert row_effects._stale(rec, repeats(0.029), None) is None
    found = row_effects._stale(rec, repeats(0.031), None)
    assert (found.effect, found.rise, found.channels) == ("timing.stale", 0.0, CHANNELS)
    assert found.probability == pytest.approx(0.99 * ndtr((0.031 - 0.015) / 0.005))
    assert found.parameters["share"]["value"] == 0.031
    assert "3.1 % of the rows repeat" in found.sentence and "2.0 in a run" in found.sentence
    assert row_effects._stale(rec, repeats(0.05, expected=0.025), None) is None  # counts make half
    forces = row_effects._stale(rec, repeats(0.05, channels=(0, 1, 2)), None)
    assert "rows of fx, fy, fz repeat" in forces.sentence


@pytest.mark.parametrize(("late", "told"), [(0.34, False), (0.36, True)])
def test_fewer_repeats_are_told_if_they_are_late_by_enough(monkeypatch, late, told):
    monkeypatch.setattr(row_effects, "_late", lambda *_: late)
    found = row_effects._stale(recording(), repeats(0.02), None)
    assert (found and found.rise) == (late if told else None)


def test_a_repeat_is_late_by_what_moved_meanwhile():
    """One row of ten shows the one before: late by 1."""
    rec, stale = recording("dynamic"), np.arange(10) == 4
    rec.wrench[4] = rec.wrench[3]
    some, s = repeats(0.1, stale=stale), scatter(0.3, scale=0.5)

    def expected(square):
        return pytest.approx((square / 10 - 2.0 / 3.0 * 0.25 * 0.3 * 0.1) / 0.25)

    assert row_effects._late(rec, some, s) == expected(1.0)
    rec.wrench[:, 3] *= 2.0  # a channel that moves twice as fast
    assert row_effects._late(rec, some, s) == expected(4.0)
    assert row_effects._late(rec, repeats(0.1, stale=stale, channels=(0,)), s) == expected(1.0)
    for nothing in (
        (rec, some, None),
        (recording("static"), some, s),
        (rec, repeats(0.0), s),
        (rec, some, scatter(90.0)),
    ):
        assert row_effects._late(*nothing) == 0.0


def test_noise_is_told_from_a_rise_of_0_35_that_nothing_else_explains():
    variance = np.array([1.6, 1.2, 1.0, 1.0, 1.36, 1.3])
    found = row_effects._noise(scatter(variance), 0.0 * ONES)
    assert (found.effect, found.channels) == ("sensor.noise", ("fx", "ty"))
    assert found.rise == pytest.approx(0.6)
    slack = np.hypot(0.01, 0.05)
    assert found.probability == pytest.approx(0.995 * ndtr(0.25 / slack))
    told = found.parameters["std.fx"]
    assert told["value"] == pytest.approx(np.sqrt(0.6) * 2.0)
    assert told["std"] == pytest.approx(0.5 * slack * 4.0 / (np.sqrt(0.6) * 2.0))
    assert "a row of fx has 2.53 N instead of 2 N" in found.sentence
    explained = np.array([0.4, 0, 0, 0, 0, 0])
    assert row_effects._noise(scatter(variance), explained) is None  # 1.3 · 0.4 of 0.6
    assert row_effects._noise(scatter(variance, steady=False), 0.0 * ONES) is None
    for rise, sure in ((0.38, False), (0.39, True)):  # Φ((rise − 0.35) / 0.05): 0.73 and 0.79
        less = row_effects._noise(scatter(1.0 + rise, std=0.0), 0.0 * ONES)
        assert (less is not None) == sure


def shaking(rise, seen=0.0, line=None):
    return SimpleNamespace(
        rise=np.array(rise, dtype=float),
        std=0.02 * ONES,
        seen=seen * ONES,
        line=line,
        rms=0.1,
        direction=(1.0, 0.0, 0.0),
    )


@pytest.mark.parametrize(("rise", "told"), [(0.46, False), (0.48, True), (0.9, True)])
def test_a_shaking_base_is_told_when_surely_above_0_45(rise, told):
    found = row_effects._vibration(scatter(), shaking([0.1, rise, 0.46, 0.0, 0.0, 0.0]))
    assert (found is not None) == told
    if found is not None:
        slack = np.hypot(0.02, 0.05 * rise)
        assert found.probability == pytest.approx(0.995 * ndtr((rise - 0.45) / slack))
        assert found.channels == ("fy", "fz")
        assert found.rise == pytest.approx(rise)
        amplitude = found.parameters["amplitude.fy"]
        assert amplitude["value"] == pytest.approx(np.sqrt(2.0 * rise) * 2.0)
        assert amplitude["std"] == pytest.approx(0.02 * 4.0 / (np.sqrt(2.0 * rise) * 2.0))
        assert "frequency" not in found.parameters and "over a broad band" in found.sentence


def test_a_line_has_a_frequency_and_without_a_stated_noise_the_rest_is_the_measure():
    tone, rise = SimpleNamespace(frequency=12.3, std=0.1), [0.4, 0, 0, 0, 0, 0]
    found = row_effects._vibration(scatter(stated=False), shaking(rise, 0.5, tone))
    assert found.rise == pytest.approx(0.8)
    assert found.parameters["frequency"] == {"value": 12.3, "std": 0.1, "unit": "Hz"}
    assert "at 12.30 Hz" in found.sentence
    most = row_effects._vibration(scatter(stated=False), shaking(rise, 2.0))
    assert most.rise == pytest.approx(0.4 / 0.05)


def test_few_rows_say_nothing_and_repeats_of_some_channels_are_no_effect_of_the_twin():
    assert RowFinding("timing.stale", 0.9, 0.1, ("fx",), {}, "").active(None) is None
    assert row_effects.find_row_effects([1, 2], None) == ()
