"""The noise that a stream adds is the noise that its model states."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy import signal

from wrenchbed.errors import ParameterError
from wrenchbed.physics.noise import REST_S, SATURATED_BITS, NoiseModel, NoiseStream

SIX = np.array([0.02, 0.03, 0.05, 0.001, 0.002, 0.0005])
LEVER = np.eye(6)
LEVER[0, 4] = LEVER[4, 0] = 0.9
LEVER[1, 3] = LEVER[3, 1] = -0.8
FULL = NoiseModel(
    white=SIX,
    flicker=SIX / 3,
    correlation=LEVER,
    mains_amplitude=SIX,
    warmup_drift=10 * SIX,
    warmup_time=60.0,
    resolution=SIX / 10,
    range=40 * SIX,
)


def rest(model: NoiseModel, rate: float, seconds: float, seed: int = 1) -> np.ndarray:
    """Rows (N, 6) of an unloaded sensor."""
    t = np.arange(round(rate * seconds)) / rate
    return NoiseStream(model, seed).corrupt(t, np.zeros((len(t), 6)))[0]


def stated(model: NoiseModel, frequency: np.ndarray, rate: float) -> np.ndarray:
    """One-sided density (F, 6) of white and 1/f part, without what sampling folds back."""
    f = frequency[:, None]
    corners = np.arctan(model.f_high / f) - np.arctan(model.f_low / f)
    return 2 * model.white**2 / rate + model.flicker**2 / f * corners * 2 / np.pi


LAWS = {
    "white": (NoiseModel(white=SIX), 500.0, 200.0, 1000, [2.0, 10.0, 50.0, 249.0], 0.0),
    "1/f": (NoiseModel(flicker=SIX, f_low=1e-2, f_high=100.0), 1000.0, 300.0, 50_000,
            [0.1, 0.3, 1.0, 3.0, 10.0], 0.05),
    "corners": (NoiseModel(flicker=SIX, f_low=1.0, f_high=10.0), 1000.0, 400.0, 20_000,
                [0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 60.0], 0.06),
}  # fmt: skip
"""Models with rate [Hz], length [s], Welch's segment, bands' edges [Hz], ripple's share."""


@pytest.mark.parametrize("law", LAWS)
def test_the_density_of_rows_is_the_stated_one(law: str) -> None:
    """Means of bands agree within five standard errors and the ripple.

    Hann segments with half overlap are worth 1/(1 + 2/36) of their number (Welch 1967); A of them
    and B bins of six channels have the error 1/√(6·A·B/1.5): bins share 3/2 of their width.
    """
    model, rate, seconds, segment, edges, ripple = LAWS[law]
    rows = rest(model, rate, seconds)
    f, p = signal.welch(rows, rate, nperseg=segment, axis=0)
    averages = (2 * len(rows) // segment - 1) / (1 + 2 / 36)
    for low, high in itertools.pairwise(edges):
        inside = (f >= low) & (f < high)
        ratio = (p[inside] / stated(model, f[inside], rate)).mean()
        error = 1 / np.sqrt(6 * averages * inside.sum() / 1.5)
        assert abs(ratio - 1) < 5 * error + ripple, (low, high, ratio, error)


def test_flicker_noise_keeps_its_law_at_irregular_times() -> None:
    model = NoiseModel(flicker=np.ones(6), correlation=LEVER, f_low=1e-2, f_high=100.0)
    steps = np.random.default_rng(5).choice([0.003, 0.1, 3.0], size=12_000)
    t = np.cumsum(steps)
    rows = NoiseStream(model, 2).corrupt(t, np.zeros((len(t), 6)))[0]
    assert np.abs(np.corrcoef(np.diff(rows, axis=0).T) - LEVER).max() < 0.05
    rates = 2 * np.pi * np.geomspace(1e-2, 100.0, 20_001)
    for step in (0.003, 0.1, 3.0):
        squares = (np.diff(rows, axis=0)[steps[1:] == step] ** 2).mean()
        expected = np.trapezoid(2 * -np.expm1(-rates * step), np.log(rates))
        assert squares == pytest.approx(expected, rel=0.05), step


def test_row_std_is_what_rests_show() -> None:
    model = NoiseModel(white=SIX, flicker=SIX, mains_amplitude=SIX, resolution=SIX / 2)
    rests = [rest(model, 250.0, REST_S, seed).var(axis=0) for seed in range(60)]
    ratio = np.mean(rests, axis=0) / model.row_std**2
    assert ratio.mean() == pytest.approx(1.0, abs=0.04)
    for seconds in (1.0, 60.0):
        rows = [rest(model, 250.0, seconds, seed).var(axis=0) for seed in range(10)]
        shift = np.log(seconds / REST_S) * SIX**2
        excess = (np.mean(rows, axis=0) - shift).mean()
        assert excess == pytest.approx((model.row_std**2).mean(), rel=0.1)


def test_mains_is_a_sine_of_the_stated_amplitude_and_a_phase_of_its_own() -> None:
    model = NoiseModel(white=SIX, mains_amplitude=2 * SIX, mains_frequency=50.0)
    phases = []
    for seed in (1, 2):
        rate, rows = 698.1, rest(model, 698.1, 60.0, seed)
        angle = 2 * np.pi * 50.0 * np.arange(len(rows)) / rate
        sine, cosine = np.linalg.lstsq(np.c_[np.sin(angle), np.cos(angle)], rows, rcond=None)[0]
        error = np.sqrt(2 / len(rows)) * SIX
        assert (np.abs(np.hypot(sine, cosine) - 2 * SIX) < 5 * error).all()
        phases.extend(np.arctan2(cosine, sine))
    assert np.diff(np.sort(phases)).min() > 1e-3


def test_readings_lie_on_the_resolution_grid() -> None:
    step = np.array([0.1, 0.1, 0.2, 0.01, 0.01, 0.0])
    rows = rest(NoiseModel(white=SIX, resolution=step), 100.0, 10.0)
    words = rows[:, :5] / step[:5]
    np.testing.assert_allclose(words, np.rint(words), atol=1e-9)
    assert len(np.unique(rows[:, 5])) == len(rows)
    load = np.random.default_rng(3).uniform(-1, 1, (1000, 6))
    measured, _ = NoiseStream(NoiseModel(resolution=step), 1).corrupt(np.arange(1000), load)
    assert (np.abs(measured - load) <= step / 2 + 1e-12).all()


def test_readings_saturate_at_the_range_and_the_status_names_the_channels() -> None:
    limit = np.array([10.0, 10.0, 20.0, 1.0, 1.0, 1.0])
    load = np.zeros((14, 6))
    for i in range(6):
        load[1 + i, i] = 1.5 * limit[i]
        load[7 + i, i] = -1.5 * limit[i]
    load[13] = 2 * limit
    measured, status = NoiseStream(NoiseModel(range=limit), 1).corrupt(np.arange(14.0), load)
    assert status.dtype == np.uint32
    assert status.tolist() == [0, *[1 << i for i in range(6)] * 2, 63]
    assert SATURATED_BITS.tolist() == [1, 2, 4, 8, 16, 32]
    np.testing.assert_array_equal(measured, np.clip(load, -limit, limit))
    below, ok = NoiseStream(NoiseModel(range=limit), 1).corrupt([0.0], 0.999 * limit[None])
    assert ok[0] == 0 and (below < limit).all()


def test_warm_up_approaches_its_end_exponentially() -> None:
    drift = np.array([0.1, -0.2, 0.3, 0.01, -0.02, 0.0])
    t = np.linspace(0.0, 5000.0, 200)
    cold = NoiseModel(warmup_drift=drift, warmup_time=900.0)
    shown = NoiseStream(cold, 1).corrupt(t, np.zeros((200, 6)))[0]
    np.testing.assert_allclose(shown, drift * (1 - np.exp(-t / 900.0))[:, None], atol=1e-15)
    warm = replace(cold, warmup_age=1800.0)
    rest_of_it = NoiseStream(warm, 1).corrupt(t, np.zeros((200, 6)))[0]
    np.testing.assert_allclose(rest_of_it, np.exp(-2.0) * shown, atol=1e-15)


GAPS = np.random.default_rng(8).uniform(1e-3, 0.5, 40)
HOLDS = [np.full(150, 0.01), np.array([2.5]), np.full(100, 0.01), GAPS, np.array([600.0])]
CLOCK: np.ndarray = np.cumsum(np.concatenate([*HOLDS, np.full(90, 1 / 698.1)]))
LOAD = np.random.default_rng(9).normal(size=(len(CLOCK), 6))
WHOLE = NoiseStream(FULL, 11).corrupt(CLOCK, LOAD)


@settings(max_examples=30, deadline=None, derandomize=True)
@example(set(range(len(CLOCK))))
@given(st.sets(st.integers(0, len(CLOCK)), max_size=12))
def test_splitting_rows_into_calls_changes_no_bit(cuts: set[int]) -> None:
    stream, edges = NoiseStream(FULL, 11), [0, *sorted(cuts), len(CLOCK)]
    parts = [stream.corrupt(CLOCK[a:b], LOAD[a:b]) for a, b in itertools.pairwise(edges)]
    np.testing.assert_array_equal(np.concatenate([p[0] for p in parts]), WHOLE[0])
    np.testing.assert_array_equal(np.concatenate([p[1] for p in parts]), WHOLE[1])


@pytest.mark.parametrize(
    ("t", "rows", "message"),
    [
        ([1.0, 1.0], 2, "row 1 does not increase"),
        ([0.0, 2.0], 2, "row 0 does not increase"),
        ([1.0, np.nan], 2, "row 1 does not increase"),
        ([1.0, 2.0], 3, r"must be \(N,\) and \(N, 6\)"),
        ([[1.0]], 1, r"must be \(N,\) and \(N, 6\)"),
    ],
)
def test_impossible_rows_are_refused(t: list[float], rows: int, message: str) -> None:
    stream = NoiseStream(FULL, 1)
    stream.corrupt([0.5], np.zeros((1, 6)))
    with pytest.raises(ParameterError, match=message):
        stream.corrupt(t, np.zeros((rows, 6)))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("white", -SIX),
        ("white", SIX[:5]),
        ("flicker", SIX * np.nan),
        ("correlation", np.eye(5)),
        ("correlation", np.full((6, 6), 2.0)),
        ("correlation", np.eye(6) + 0.9 * np.eye(6, k=1) + 0.9 * np.eye(6, k=-1)),
        ("f_low", 0.0),
        ("f_high", 1e-4),
        ("mains_frequency", -50.0),
        ("warmup_time", 0.0),
    ],
)
def test_impossible_models_are_refused(field: str, value: object) -> None:
    with pytest.raises(ParameterError, match="warmup" if "warm" in field else field):
        NoiseModel(**{field: value})  # type: ignore[arg-type]


def test_a_model_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="read-only"):
        FULL.white[0] = 1.0
