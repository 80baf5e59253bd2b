"""Effects on readings, clocks and rows against numbers worked out by hand."""

import numpy as np
import pytest
from effect_scenes import columns, scene_of
from hypothesis import given, settings
from hypothesis import strategies as st

from wrenchbed import registry
from wrenchbed.effects.scene import Scene
from wrenchbed.errors import ParameterError
from wrenchbed.physics.time_derivatives import Jet


def reading(name, scene, y, **given):
    effect = registry.load("effects", name)
    given = {k.replace("_", "."): v for k, v in given.items()}
    return effect.read(scene, y, effect.values(scene.robot, given))


def at_times(t, warmth=None):
    robot = registry.load("robots", "ur5")
    q, held = np.tile(robot.home, (len(t), 1)), np.ones(len(t), dtype=bool)
    return Scene(robot, robot.parameters.nominal, np.array(robot.gravity), q, t, held, warmth)


def moving(t):
    robot = registry.load("robots", "ur5")
    q = np.tile(robot.home, (len(t), 1))
    still = Jet(q, np.zeros_like(q), np.zeros_like(q))
    held = np.ones(len(t), dtype=bool)
    return Scene(robot, robot.parameters.nominal, np.array(robot.gravity), still, t, held)


ROW = np.array([[1.0, 2.0, 3.0, 0.1, 0.2, 0.3]])


def test_gain_bias_and_crosstalk():
    scene = at_times(np.zeros(1))
    gained = reading("sensor.gain", scene, ROW, gain_fy=0.01, gain_tz=-0.5)
    assert np.allclose(gained, [[1.0, 2.02, 3.0, 0.1, 0.2, 0.15]])
    biased = reading("sensor.bias", scene, ROW, bias_fz=0.5)
    assert np.allclose(biased, [[1.0, 2.0, 3.5, 0.1, 0.2, 0.3]])
    crossed = reading("sensor.crosstalk", scene, ROW, x_fx_fy=0.1, x_tz_fx=0.01, x_fz_tx=2.0)
    assert np.allclose(crossed, [[1.2, 2.0, 3.2, 0.1, 0.2, 0.31]])
    shifted = reading("sensor.crosstalk", scene, ROW, origin_x=0.1, origin_y=0.2, origin_z=0.3)
    assert np.allclose(shifted[0, 3:], ROW[0, 3:] + np.cross([0.1, 0.2, 0.3], ROW[0, :3]))


def test_drift_and_jump_in_time():
    scene = at_times(np.array([100.0, 110.0, 130.0]))
    y = np.zeros((3, 6))
    drifted = reading("sensor.drift", scene, y, rate_fx=0.01, rate_tz=-1e-3)
    assert np.allclose(drifted[:, 0], [0.0, 0.1, 0.3])
    assert np.allclose(drifted[:, 5], [0.0, -0.01, -0.03])
    jumped = reading("sensor.jump", scene, y, step_fy=2.0, time=120.0)
    assert np.array_equal(jumped[:, 1], [0.0, 0.0, 2.0])
    assert np.array_equal(jumped[:, 0], y[:, 0])


def test_jumps_begin_between_measured_rows_at_few_moments():
    scene = scene_of("ur5 static")
    found = registry.load("effects", "sensor.jump").variants(scene)
    moments = {v.at["time"] for v in found}
    t = scene.t[scene.held]
    assert len(moments) == 24
    assert len(columns("sensor.jump", "ur5 static")) == 24 * 6
    assert all(np.isclose(m, (t[1:] + t[:-1]) / 2.0).any() for m in moments)
    short = registry.load("effects", "sensor.jump").variants(at_times(np.arange(3.0)))
    assert {v.at["time"] for v in short} == {0.5, 1.5}


def test_a_clipped_channel_has_a_flat_top():
    y = np.outer([-20.0, -5.0, 5.0, 20.0], np.ones(6))
    scene = at_times(np.arange(4.0))
    effect = registry.load("effects", "sensor.saturation")
    values = effect.values(scene.robot, {"channel": "fy", "level": 10.0})
    assert np.array_equal(effect.read(scene, y, values)[:, 1], [-10.0, -5.0, 5.0, 10.0])
    half = reading("sensor.saturation", scene, y, share_fy=0.5, level_fy=10.0)
    assert np.array_equal(half[:, 1], [-15.0, -5.0, 5.0, 15.0])
    assert np.array_equal(half[:, 0], y[:, 0])
    with pytest.raises(ParameterError, match="there is no channel 'fq': fx, fy"):
        effect.values(scene.robot, {"channel": "fq", "level": 1.0})


def test_a_level_is_published_with_its_channel():
    effect, scene = registry.load("effects", "sensor.saturation"), scene_of("ur5 static")
    variant = effect.variants(scene)[0]
    told = effect.publish(scene.robot, variant, effect.values(scene.robot, variant.at), {})
    assert told["level.fx"]["unit"] == "N" and told["channel"] == {"value": "fx"}


def test_temperature_moves_zero_and_span():
    y = np.full((3, 6), 10.0)
    warm = at_times(np.arange(3.0), np.array([0.0, 5.0, 10.0]))
    zero = reading("sensor.temperature", warm, y, zero_fx=0.1) - y
    assert np.allclose(zero[:, 0], [0.0, 0.5, 1.0]) and not zero[:, 1:].any()
    span = reading("sensor.temperature", warm, y, span=1e-3, span_fx=1e-3) - y
    assert np.allclose(span[:, :2], [[0.0, 0.0], [0.1, 0.05], [0.2, 0.1]])
    guessed = at_times(np.array([0.0, 300.0, 1e6]))
    up = reading("sensor.temperature", guessed, y, zero_fx=0.1, tau=300.0) - y
    assert np.allclose(up[:, 0], [0.0, 0.1 * (1.0 - np.exp(-1.0)), 0.1])


def test_a_sensor_lags_behind_a_recorded_ramp_by_its_time_constant():
    t = np.concatenate([np.arange(0.0, 100.0, 2.5), np.arange(100.0, 300.0, 10.0)])
    y = np.zeros((len(t), 6))
    ramp = at_times(t, 0.02 * t)
    late = reading("sensor.temperature", ramp, y, zero_fx=0.5, lag=30.0)[:, 0]
    after = 0.5 * 0.02 * (t - 30.0 * -np.expm1(-t / 30.0))  # the exact answer to a ramp
    assert late == pytest.approx(after, abs=1e-12)
    prompt = reading("sensor.temperature", ramp, y, zero_fx=0.5)[:, 0]
    assert prompt == pytest.approx(0.5 * 0.02 * t, abs=1e-15)


def test_creep_that_ends_right_starts_too_low():
    t = np.array([0.0, 1e-9, 50.0, 1000.0])
    y = np.zeros((4, 6))
    y[1:] = 2.0
    crept = reading("sensor.creep", at_times(t), y, share_fx=0.01, tau=50.0, late=1.0) - y
    assert crept[:, 0] == pytest.approx([0.0, -0.02, -0.02 * np.exp(-1.0), 0.0], abs=1e-8)
    assert not crept[:, 1:].any()


def test_play_follows_once_it_is_half_its_width_behind():
    from wrenchbed.effects.sensor_hysteresis import play

    x = np.array([0.0, 0.5, 2.0, 3.0, 2.5, 1.0, -1.0])[:, None]
    assert np.array_equal(
        play(x, np.array([1.0]))[:, 0], np.array([0.0, 0.0, 1.0, 2.0, 2.0, 2.0, 0.0])
    )
    y = x * np.ones(6)
    lagged = reading("sensor.hysteresis", at_times(np.arange(7.0)), y, lag_fx=0.1, width=0.25) - y
    assert np.allclose(lagged[[0, 2, 3, 6], 0], [0.0, -0.1, -0.1, 0.1])


def test_the_delay_of_a_sine():
    t = np.arange(1000) / 125.0
    omega = 2.0 * np.pi * np.arange(1, 7)
    late = reading("timing.delay", moving(t), np.sin(t[:, None] * omega), delay=0.0117)
    inside = t > 0.05
    assert np.abs(late - np.sin((t[:, None] - 0.0117) * omega))[inside].max() < 2e-4
    early = reading("timing.delay", moving(t), np.sin(t[:, None] * omega), delay=-0.0117)
    assert np.abs(early - np.sin((t[:, None] + 0.0117) * omega))[t < 7.9].max() < 5e-4


def test_a_lowpass_turns_and_shrinks_a_sine():
    t = np.arange(5000) / 1000.0
    omega, tau = 2.0 * np.pi * np.arange(1, 7), 0.02
    y = np.sin(t[:, None] * omega)
    smooth = reading("timing.lowpass", moving(t), y, tau=tau)
    size, phase = 1.0 / np.hypot(1.0, tau * omega), np.arctan(tau * omega)
    assert np.abs(smooth - size * np.sin(t[:, None] * omega - phase))[t > 0.5].max() < 1e-4
    mirrored = reading("timing.lowpass", moving(t), y, tau=-tau)
    assert np.allclose(mirrored - y, y - smooth)


def corrupted(name, rows, t=None, seed=0, **given):
    effect, robot = registry.load("effects", name), registry.load("robots", "ur5")
    t = np.arange(len(rows)) / 125.0 if t is None else t
    p = effect.values(robot, {k.replace("_", "."): v for k, v in given.items()})
    return effect.corrupt(rows, t, p, np.random.default_rng(seed))


def test_quantization_rounds_to_the_step_and_only_where_there_is_one():
    rows = np.array([[0.24, 0.24, -0.26, 0.001, 0.24, 0.24]])
    shown = corrupted("sensor.quantization", rows, step_fx=0.1, step_fz=0.5, step_tx=0.01)
    assert np.allclose(shown, [[0.2, 0.24, -0.5, 0.0, 0.24, 0.24]])


def test_vibration_is_a_line_at_its_frequency():
    shown = corrupted("base.vibration", np.zeros((1250, 6)), amplitude_fz=0.4, frequency=12.5)
    spectrum = np.abs(np.fft.rfft(shown[:, 2])) / 625.0
    assert np.argmax(spectrum) == 125 and np.isclose(spectrum[125], 0.4)
    assert not shown[:, :2].any()
    other = corrupted("base.vibration", np.zeros((1250, 6)), seed=1, amplitude_fz=0.4)
    assert not np.allclose(shown, other)


@settings(deadline=None, max_examples=40)
@given(st.integers(1, 400), st.integers(1, 6), st.floats(1e-3, 3.0), st.integers(0, 1000))
def test_play_in_blocks_is_the_loop_bit_for_bit(rows, channels, half, seed):
    from wrenchbed.effects.sensor_hysteresis import play

    x = np.random.default_rng(seed).uniform(-1.0, 1.0, (rows, channels))
    state, path = x[0], []
    for value in x:
        state = np.clip(state, value - half, value + half)
        path.append(state)
    for _ in range(2):  # computed, then kept
        assert np.array_equal(play(x, np.full(channels, half)), np.array(path))
