"""Effects in the sensor and its clock: loops, levels, lags and filters in numbers done by hand."""

import numpy as np
import pytest
from hypothesis import given as generated
from hypothesis import settings
from hypothesis import strategies as st

from wrenchbed import registry
from wrenchbed.effects.drives.operators import play
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.taylor_jets import Jet
from wrenchbed.physics.wrench import CHANNELS


def rows_at(t, warmth=None, moves=False):
    robot = registry.load("robots", "ur5")
    q = np.tile(robot.home, (len(t), 1))
    q = Jet(q, 0.0 * q, 0.0 * q) if moves else q
    gravity = np.array(robot.gravity)
    return Scene(robot, robot.parameters.nominal, gravity, q, t, np.ones(len(t), bool), warmth)


def change(name, scene, y, given):
    effect = registry.load("effects", name)
    before = y.copy()
    result = effect.read(scene, y, effect.values(scene.robot, given)) - y
    assert np.array_equal(y, before)
    return result


def reading(name, scene, y, **given):
    return y + change(name, scene, y, {k.replace("_", "."): v for k, v in given.items()})


def corrupted(name, rows, t=None, seed=0, **given):
    effect, robot = registry.load("effects", name), registry.load("robots", "ur5")
    t = np.arange(len(rows)) / 125.0 if t is None else t
    p = effect.values(robot, {k.replace("_", "."): v for k, v in given.items()})
    return effect.corrupt(rows, t, p, np.random.default_rng(seed))


UP = np.linspace(-8.0, 12.0, 201)
LOOP = np.concatenate([UP, UP[-2::-1]])
"""Up and down over a range of 20, in steps of 0.1."""


def lag_of(half):
    """What a play with a half width lacks on the loop: nothing moves until it is half behind."""
    back = UP[-2::-1]
    up = np.maximum(UP - half, -8.0)
    down = np.minimum(back + half, 12.0 - half)
    return (np.concatenate([up, down]) - LOOP) / half


@pytest.mark.parametrize("width", [1.0, 0.5])
@pytest.mark.parametrize(("kind", "half"), [("narrow", 0.8), ("middle", 3.0), ("wide", 10.0)])
def test_a_loop_of_hysteresis_is_as_wide_as_twice_its_lag(kind, half, width):
    """4, 15 and 50 % of the range of 20."""
    y = np.zeros((len(LOOP), 6))
    y[:, 1] = LOOP
    scene, half = rows_at(np.arange(len(LOOP)) * 1.0), half * width
    found = change("sensor.hysteresis", scene, y, {f"{kind}.fy": 0.3, "width": width})
    assert found[:, 1] == pytest.approx(0.3 * lag_of(half), abs=1e-9)
    assert not np.delete(found, 1, axis=1).any()
    tilted = change("sensor.hysteresis", scene, y, {f"{kind}.slope.fy": 0.3, "width": width})
    assert tilted[:, 1] == pytest.approx(0.3 * (LOOP - 2.0) / 10.0 * lag_of(half), abs=1e-9)


def test_every_channel_bends_about_its_own_full_scale():
    """20 N, 2 N·m, and 0.2 N·m about z: there a bend of 1 % is 1 % of that."""
    full = np.array([20.0, 20.0, 20.0, 2.0, 2.0, 0.2])
    y = np.stack([full, -full, 0.5 * full])
    scene = rows_at(np.arange(3.0))
    for k, c in enumerate(CHANNELS):
        for law, power, expected in (
            ("even", 2.0, [1.0, 1.0, 0.25]),
            ("odd", 3.0, [1.0, -1.0, 0.125]),
            ("even", 1.0, [1.0, 1.0, 0.5]),
            ("odd", 1.0, [1.0, -1.0, 0.5]),
        ):
            found = change("sensor.nonlinearity", scene, y, {f"{law}.{c}": 0.01, "power": power})
            assert found[:, k] == pytest.approx(0.01 * full[k] * np.array(expected))
            assert not np.delete(found, k, axis=1).any()


def test_before_the_first_reading_and_after_the_last_it_stands_still():
    t = 20.0 + np.arange(100) / 100.0
    y = np.outer(t**2, np.arange(1.0, 7.0))
    scene = rows_at(t, moves=True)
    for name, given, early, late in (
        ("timing.delay", {"delay": 0.105}, True, False),
        ("timing.delay", {"delay": -0.105}, False, True),
        ("timing.skew", {"channel": 0.021}, True, False),
        ("timing.skew", {"channel": -0.021}, False, True),
        ("timing.skew", {"skew": -0.1}, False, True),
    ):
        shown = y + change(name, scene, y, given)
        assert (shown[:4, 5] == y[0, 5]).all() == early, (name, given)
        assert (shown[-4:, 5] == y[-1, 5]).all() == late, (name, given)
    for delay in (0.105, -0.105):
        shown = y + change("timing.delay", scene, y, {"delay": delay})
        expected = np.outer((t - delay) ** 2, np.arange(1.0, 7.0))
        assert shown[20:-20] == pytest.approx(expected[20:-20], rel=1e-9)
    y, given = np.outer(t**3, np.ones(6)), {"skew": 0.01, "channel": 0.003}  # both together
    shown = y + change("timing.skew", scene, y, given)
    then = (t - 0.01 * (t - 20.0))[:, None] - 0.003 * np.arange(6)
    inside = then[:, 5] > 20.0
    assert shown[inside] == pytest.approx((then**3)[inside], rel=1e-9)


@pytest.mark.parametrize(("stages", "tau"), [(1, 0.004), (1, 0.1), (2, 0.02), (3, 0.1)])
def test_stages_in_a_row_share_their_time_constant(stages, tau):
    t = np.arange(3000) / 500.0
    omega = 2.0 * np.pi * np.array([0.5, 1.0, 2.0, 4.0, 8.0, 16.0])
    wave = np.sin(t[:, None] * omega)
    given = {"tau": tau, "stages": float(stages)}
    shown = wave + change("timing.lowpass", rows_at(t, moves=True), wave, given)
    response = (1.0 + 1j * omega * tau / stages) ** -stages
    expected = np.imag(response * np.exp(1j * t[:, None] * omega))
    piece = min(1.0 / 500.0, tau / stages / 4.0)
    error = np.abs(shown - expected)[t > 12.0 * tau].max(axis=0)
    straight = (omega * piece) ** 2 / 8.0  # what a wave differs from straight pieces by, each time
    assert (error <= stages * straight + 1e-5).all()
    mirrored = change("timing.lowpass", rows_at(t, moves=True), wave, given | {"tau": -tau})
    assert np.allclose(mirrored, wave - shown)


@pytest.mark.parametrize("even", [True, False])
@pytest.mark.parametrize("late", [0.0, 1.0])
def test_creep_under_a_ramp_of_load(even, late):
    """Of a ramp r t, z = r (t − τ (1 − e^(−t/τ))): the exact answer between all rows."""
    t = np.arange(0.0, 300.0, 3.0)
    if not even:
        t = t[np.random.default_rng(4).random(len(t)) < 0.5]
        t[0] = 0.0
    y = 7.0 + np.outer(0.2 * t, np.arange(1.0, 7.0))
    z = 7.0 + np.outer(0.2 * (t - 40.0 * -np.expm1(-t / 40.0)), np.arange(1.0, 7.0))
    given = {"share.fy": 0.01, "share.tz": -0.02, "tau": 40.0, "late": late}
    found = change("sensor.creep", rows_at(t), y, given)
    end = y if late else 7.0
    assert found[:, 1] == pytest.approx((0.01 * (z - end))[:, 1], abs=1e-12)
    assert found[:, 5] == pytest.approx((-0.02 * (z - end))[:, 5], abs=1e-12)
    assert not found[:, [0, 2, 3, 4]].any()


def test_noise_steps_and_repeats_act_on_rows():
    """A row is stale as a whole, and the first is fresh."""
    shown = corrupted("sensor.noise", np.full((20000, 6), 5.0), np.arange(20000.0), 1,
                      std_fx=0.2, std_fy=0.2)  # fmt: skip
    assert np.abs(np.corrcoef(shown[:, :2].T)[0, 1]) < 0.03
    assert shown[:, :2].mean(axis=0) == pytest.approx(5.0, abs=0.01)
    assert shown.std(axis=0) == pytest.approx([0.2, 0.2, 0, 0, 0, 0], rel=0.03)
    assert (shown[:, 2:] == 5.0).all()
    rows = np.array([[0.24, 0.24, -0.26, 0.001, 0.24, 0.24]])
    shown = corrupted("sensor.quantization", rows, step_fx=0.1, step_fz=0.5, step_tx=0.01)
    assert np.allclose(shown, [[0.2, 0.24, -0.5, 0.0, 0.24, 0.24]])
    shown = corrupted("base.vibration", np.zeros((1250, 6)), amplitude_fz=0.4, frequency=12.5)
    spectrum = np.abs(np.fft.rfft(shown[:, 2])) / 625.0
    assert np.argmax(spectrum) == 125 and np.isclose(spectrum[125], 0.4)
    assert not shown[:, :2].any()
    other = corrupted("base.vibration", np.zeros((1250, 6)), seed=1, amplitude_fz=0.4)
    assert not np.allclose(shown, other)
    rows = np.random.default_rng(3).standard_normal((4000, 6))
    for seed in range(5):
        shown = corrupted("timing.stale", rows, np.arange(4000.0), seed, share=0.6)
        assert np.array_equal(shown[0], rows[0])
        same = shown == rows
        assert (same.all(axis=1) | ~same.any(axis=1)).all()
        assert same.all(axis=1).mean() == pytest.approx(0.4, abs=0.04)
    assert np.array_equal(corrupted("timing.stale", rows, np.arange(4000.0), 1), rows)


ROW = np.array([[1.0, 2.0, 3.0, 0.1, 0.2, 0.3]])


def test_gains_zeros_and_crosstalk_are_matrices():
    scene = rows_at(np.zeros(1))
    gained = reading("sensor.gain", scene, ROW, gain_fy=0.01, gain_tz=-0.5)
    assert np.allclose(gained, [[1.0, 2.02, 3.0, 0.1, 0.2, 0.15]])
    biased = reading("sensor.bias", scene, ROW, bias_fz=0.5)
    assert np.allclose(biased, [[1.0, 2.0, 3.5, 0.1, 0.2, 0.3]])
    shifted = reading("sensor.crosstalk", scene, ROW, origin_x=0.1, origin_y=0.2, origin_z=0.3)
    assert np.allclose(shifted[0, 3:], ROW[0, 3:] + np.cross([0.1, 0.2, 0.3], ROW[0, :3]))
    # Each pair by a number of its own: what the first shows of the second.
    x = 1e-3 * np.arange(1.0, 37.0).reshape(6, 6)
    np.fill_diagonal(x, 0.0)
    pairs = np.argwhere(~np.eye(6, dtype=bool))
    given = {f"x.{CHANNELS[i]}.{CHANNELS[j]}": x[i, j] for i, j in pairs}
    y = np.random.default_rng(6).standard_normal((5, 6))
    found = change("sensor.crosstalk", rows_at(np.arange(5.0)), y, given)
    assert found == pytest.approx(np.einsum("ij,mj->mi", x, y), abs=1e-12)


def test_drift_and_jump_in_time():
    scene = rows_at(np.array([100.0, 110.0, 130.0]))
    y = np.zeros((3, 6))
    drifted = reading("sensor.drift", scene, y, rate_fx=0.01, rate_tz=-1e-3)
    assert np.allclose(drifted[:, 0], [0.0, 0.1, 0.3])
    assert np.allclose(drifted[:, 5], [0.0, -0.01, -0.03])
    wave = reading("sensor.drift", scene, y, wave2_fx=0.1, duration=30.0)[:, 0]
    assert wave == pytest.approx(3.0 / np.pi * np.sin(np.pi / 30.0 * np.array([0.0, 10.0, 30.0])))
    jumped = reading("sensor.jump", scene, y, step_fy=2.0, time=120.0)
    assert np.array_equal(jumped[:, 1], [0.0, 0.0, 2.0])
    assert np.array_equal(jumped[:, 0], y[:, 0])
    slipped = reading("sensor.jump", scene, y, step_fy=2.0, time=112.0, rise=5.0)
    assert slipped[:, 1] == pytest.approx([0.0, 0.2, 2.0])
    short = registry.load("effects", "sensor.jump").variants(rows_at(np.arange(3.0)))
    assert {v.at["time"] for v in short} == {0.5, 1.5}


def test_a_clipped_channel_has_a_flat_top():
    y = np.outer([-20.0, -5.0, 5.0, 20.0], np.ones(6))
    scene = rows_at(np.arange(4.0))
    clipped = reading("sensor.saturation", scene, y, share_fy=1.0, level_fy=10.0)
    assert np.array_equal(clipped[:, 1], [-10.0, -5.0, 5.0, 10.0])
    half = reading("sensor.saturation", scene, y, share_fy=0.5, level_fy=10.0)
    assert np.array_equal(half[:, 1], [-15.0, -5.0, 5.0, 15.0])
    assert np.array_equal(half[:, 0], y[:, 0])


def test_temperature_moves_zero_and_span_with_its_lag():
    y = np.full((3, 6), 10.0)
    warm = rows_at(np.arange(3.0), np.array([0.0, 5.0, 10.0]))
    zero = reading("sensor.temperature", warm, y, zero_fx=0.1) - y
    assert np.allclose(zero[:, 0], [0.0, 0.5, 1.0]) and not zero[:, 1:].any()
    span = reading("sensor.temperature", warm, y, span=1e-3, span_fx=1e-3) - y
    assert np.allclose(span[:, :2], [[0.0, 0.0], [0.1, 0.05], [0.2, 0.1]])
    guessed = rows_at(np.array([0.0, 300.0, 1e6]))
    up = reading("sensor.temperature", guessed, y, zero_fx=0.1, tau=300.0) - y
    assert np.allclose(up[:, 0], [0.0, 0.1 * (1.0 - np.exp(-1.0)), 0.1])
    t = np.concatenate([np.arange(0.0, 100.0, 2.5), np.arange(100.0, 300.0, 10.0)])
    y = np.zeros((len(t), 6))
    ramp = rows_at(t, 0.02 * t)
    for lag in (30.0, 2e-3):
        late = reading("sensor.temperature", ramp, y, zero_fx=0.5, lag=lag)[:, 0]
        after = 0.5 * 0.02 * (t - lag * -np.expm1(-t / lag))  # the exact answer to a ramp
        assert late == pytest.approx(after, abs=1e-12)
    prompt = reading("sensor.temperature", ramp, y, zero_fx=0.5)[:, 0]
    assert prompt == pytest.approx(0.5 * 0.02 * t, abs=1e-15)


@settings(deadline=None, max_examples=40)
@generated(st.integers(1, 400), st.integers(1, 6), st.floats(1e-3, 3.0), st.integers(0, 1000))
def test_play_in_blocks_is_the_loop_bit_for_bit(rows, channels, half, seed):
    x = np.random.default_rng(seed).uniform(-1.0, 1.0, (rows, channels))
    state, path = x[0], []
    for value in x:
        state = np.clip(state, value - half, value + half)
        path.append(state)
    for _ in range(2):  # computed, then kept
        assert np.array_equal(play(x, half), np.array(path))
