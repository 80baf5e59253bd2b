"""Effects in the sensor and its clock: loops, levels, lags and filters in numbers done by hand."""

import numpy as np
import pytest
from effect_scenes import scene_of
from scipy.spatial.transform import Rotation

from wrenchbed import registry
from wrenchbed.effects.scene import Scene
from wrenchbed.errors import ParameterError
from wrenchbed.physics.time_derivatives import Jet
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


# ---- hysteresis --------------------------------------------------------------------------------

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
@pytest.mark.parametrize(("play", "half"), [("narrow", 0.8), ("middle", 3.0), ("wide", 10.0)])
def test_a_loop_of_hysteresis_is_as_wide_as_twice_its_lag(play, half, width):
    """4, 15 and 50 % of the range of 20."""
    y = np.zeros((len(LOOP), 6))
    y[:, 1] = LOOP
    scene, half = rows_at(np.arange(len(LOOP)) * 1.0), half * width
    found = change("sensor.hysteresis", scene, y, {f"{play}.fy": 0.3, "width": width})
    assert found[:, 1] == pytest.approx(0.3 * lag_of(half), abs=1e-9)
    assert not np.delete(found, 1, axis=1).any()
    tilted = change("sensor.hysteresis", scene, y, {f"{play}.slope.fy": 0.3, "width": width})
    assert tilted[:, 1] == pytest.approx(0.3 * (LOOP - 2.0) / 10.0 * lag_of(half), abs=1e-9)


def test_plays_of_several_channels_and_widths_add_up():
    y = np.stack([LOOP, *[0.0 * LOOP] * 2, 0.1 * LOOP, *[0.0 * LOOP] * 2], axis=1)
    scene = rows_at(np.arange(len(LOOP)) * 1.0)
    given = {"narrow.fx": 0.1, "wide.fx": 0.2, "middle.tx": 0.01, "middle.slope.tx": 0.02}
    found = change("sensor.hysteresis", scene, y, given)
    alone = [change("sensor.hysteresis", scene, y, {n: v}) for n, v in given.items()]
    assert found == pytest.approx(np.sum(alone, axis=0), abs=1e-12)
    assert found[:, 3] == pytest.approx((0.01 + 0.02 * (LOOP - 2.0) / 10.0) * lag_of(3.0), abs=1e-9)


def test_typical_hysteresis_is_one_loop_a_channel():
    effect = registry.load("effects", "sensor.hysteresis")
    for v in effect.variants(scene_of("ur5 static")):
        label = v.label.removesuffix(", brisk moves")
        channels = CHANNELS if label == "all channels" else {
            "forces": CHANNELS[:3], "torques": CHANNELS[3:]}.get(label, (label,))  # fmt: skip
        assert set(effect.usual(v)) == {f"middle.{c}" for c in channels}
    other = registry.load("effects", "sensor.bias")
    assert other.usual(other.variants(scene_of("ur5 static"))[6]) == (
        "bias.fx",
        "bias.fy",
        "bias.fz",
    )


# ---- levels, temperatures ------------------------------------------------------------------------


def test_a_channel_is_clipped_by_its_short_names():
    effect, robot = registry.load("effects", "sensor.saturation"), registry.load("robots", "ur5")
    nominal = effect.values(robot, {})
    assert effect.values(robot, {"channel": "tz", "level": 0.2}) == nominal | {
        "share.tz": 1.0, "level.tz": 0.2,
    }  # fmt: skip
    half = effect.values(robot, {"channel": "fx", "level": 10.0, "share": 0.5, "level.fy": 3.0})
    assert half == nominal | {"share.fx": 0.5, "level.fx": 10.0, "level.fy": 3.0}
    assert effect.values(robot, {"share.fx": 0.5}) == nominal | {"share.fx": 0.5}
    with pytest.raises(ParameterError):
        effect.values(robot, {"level": 10.0})


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


@pytest.mark.parametrize(("lag", "late"), [(0.0, 0.0), (0.5e-3, 0.0), (2e-3, 2e-3), (5.0, 5.0)])
def test_a_lag_below_a_millisecond_is_none(lag, late):
    t = np.arange(0.0, 200.0, 2.0)
    y = np.zeros((len(t), 6))
    found = change("sensor.temperature", rows_at(t, 3.0 * t), y, {"zero.fx": 1.0, "lag": lag})
    assert found[-1, 0] == pytest.approx(3.0 * (t[-1] - late), abs=1e-9)


# ---- time --------------------------------------------------------------------------------------


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
    late = y + change("timing.delay", scene, y, {"delay": 0.105})
    assert late[30:] == pytest.approx(
        np.outer((t[30:] - 0.105) ** 2, np.arange(1.0, 7.0)), rel=1e-9
    )


@pytest.mark.parametrize(
    ("name", "given"),
    [("timing.delay", {"delay": 0.1}), ("timing.lowpass", {"tau": 0.1}),
     ("timing.skew", {"skew": 0.01}), ("timing.skew", {"channel": 0.01})],
)  # fmt: skip
def test_readings_are_late_only_in_a_motion(name, given):
    t = np.arange(50.0) / 10.0
    y = np.outer(t**2, np.ones(6))
    assert np.abs(change(name, rows_at(t, moves=True), y, given)[-1]).max() > 1e-3
    assert not change(name, rows_at(t), y, given).any()


def test_clock_and_channels_lag_together():
    t = 5.0 + np.arange(400) / 100.0
    y = np.outer(t**3, np.ones(6))
    given = {"skew": 0.01, "channel": 0.003}
    shown = y + change("timing.skew", rows_at(t, moves=True), y, given)
    then = (t - 0.01 * (t - 5.0))[:, None] - 0.003 * np.arange(6)
    inside = then[:, 5] > 5.0
    assert shown[inside] == pytest.approx((then**3)[inside], rel=1e-9)


@pytest.mark.parametrize("tau", [0.004, 0.02, 0.1])
@pytest.mark.parametrize("stages", [1, 2, 3])
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


# ---- creep -------------------------------------------------------------------------------------


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


# ---- rows --------------------------------------------------------------------------------------


def corrupted(name, rows, t, seed, **given):
    effect, robot = registry.load("effects", name), registry.load("robots", "ur5")
    p = effect.values(robot, {k.replace("_", "."): v for k, v in given.items()})
    return effect.corrupt(rows, t, p, np.random.default_rng(seed))


def test_a_vibration_has_every_phase_and_all_channels_share_it():
    t = np.array([0.0, 0.25 / 8.0])  # a quarter of a period apart: sine and cosine of the phase
    shown = np.array([
        corrupted("base.vibration", np.zeros((2, 6)), t, seed,
                  amplitude_fx=2.0, amplitude_tz=0.5, frequency=8.0)
        for seed in range(400)
    ])  # fmt: skip
    sine, cosine = shown[:, 0, 0] / 2.0, shown[:, 1, 0] / 2.0
    assert sine**2 + cosine**2 == pytest.approx(1.0)
    quadrants = np.histogram(np.arctan2(sine, cosine), 4, (-np.pi, np.pi))[0]
    assert quadrants.min() > 70  # 100 ± 9 each
    assert shown[..., 5] == pytest.approx(0.25 * shown[..., 0])
    assert not shown[..., 1:5].any()


def test_noise_of_two_channels_is_not_the_same():
    shown = corrupted("sensor.noise", np.full((20000, 6), 5.0), np.arange(20000.0), 1,
                      std_fx=0.2, std_fy=0.2)  # fmt: skip
    assert np.abs(np.corrcoef(shown[:, :2].T)[0, 1]) < 0.03
    assert shown[:, :2].mean(axis=0) == pytest.approx(5.0, abs=0.01)
    assert shown.std(axis=0) == pytest.approx([0.2, 0.2, 0, 0, 0, 0], rel=0.03)
    assert (shown[:, 2:] == 5.0).all()


def test_a_row_is_stale_as_a_whole_and_the_first_is_fresh():
    rows = np.random.default_rng(3).standard_normal((4000, 6))
    for seed in range(5):
        shown = corrupted("timing.stale", rows, np.arange(4000.0), seed, share=0.6)
        assert np.array_equal(shown[0], rows[0])
        same = shown == rows
        assert (same.all(axis=1) | ~same.any(axis=1)).all()
        assert same.all(axis=1).mean() == pytest.approx(0.4, abs=0.04)
    assert np.array_equal(corrupted("timing.stale", rows, np.arange(4000.0), 1), rows)


# ---- crosstalk ---------------------------------------------------------------------------------


def test_crosstalk_of_every_pair_is_a_matrix():
    """Each pair by a number of its own: what the first shows of the second."""
    x = 1e-3 * np.arange(1.0, 37.0).reshape(6, 6)
    np.fill_diagonal(x, 0.0)
    given = {
        f"x.{a}.{b}": x[i, j]
        for i, a in enumerate(CHANNELS)
        for j, b in enumerate(CHANNELS)
        if i != j
    }
    y = np.random.default_rng(6).standard_normal((5, 6))
    found = change("sensor.crosstalk", rows_at(np.arange(5.0)), y, given)
    assert found == pytest.approx(np.einsum("ij,mj->mi", x, y), abs=1e-12)


def test_a_forgotten_origin_is_as_if_the_tool_were_longer():
    """5.36 mm along z, the Mini40's: the same as a shift of the CoG, whatever the mass."""
    rotation = Rotation.random(6, rng=np.random.default_rng(1))
    force = rotation.inv().apply([0.0, 0.0, -20.0])
    y = np.concatenate([force, np.cross([0.0, 0.01, 0.05], force)], axis=1)
    shown = y + change("sensor.crosstalk", rows_at(np.arange(6.0)), y, {"origin.z": 5.36e-3})
    assert shown[:, 3:] == pytest.approx(np.cross([0.0, 0.01, 0.05536], force), abs=1e-12)
    assert np.array_equal(shown[:, :3], force)
