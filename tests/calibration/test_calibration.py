"""Calibration recovers known truths, says how sure it is, and what it cannot tell."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import savgol_filter

import ntnu
import wrenchbed as wb
from altered import by_name, opposite, with_columns, with_metadata, with_rows
from simulated import MEDRUE_TRUTH, UR5_TRUTH, WHITE, driven, static
from sound import good
from wrenchbed.calibration.calibrate import CalibrationOptions, _status, calibrate, check_mass
from wrenchbed.calibration.fit import FitNoise
from wrenchbed.calibration.observations import smoothed, window_of
from wrenchbed.calibration.touch_points import Agreement, Touches
from wrenchbed.data.metadata import SensorInfo, ToolInfo
from wrenchbed.data.recording import POINT, Recording
from wrenchbed.errors import CalibrationError, ParameterError, RecordingError
from wrenchbed.physics.noise import NoiseStream
from wrenchbed.physics.rotations import quaternion
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.medrue.kinematics import IDENTIFIED, PAPER


def real() -> Recording:
    """24 poses of a robot, as if no noise were stated."""
    return with_metadata(ntnu.static(), sensor=SensorInfo("ati-gamma"))


@pytest.mark.parametrize("seed", [0, 1])
def test_medrue_is_recovered_to_rounding_without_noise(seed):
    fit = calibrate(static("medrue", MEDRUE_TRUTH, seed=seed))
    assert fit.converged
    assert fit.iterations <= 7
    assert fit.observability.rank == 27
    assert [p.name for p in fit.identified] == [n for n in PAPER.names if n in IDENTIFIED]
    for name in IDENTIFIED:
        assert abs(fit[name].value - MEDRUE_TRUTH[name]) < 1e-9, name
    assert len(fit.observability.redundancies) + len(fit.observability.no_effect) == 22


def test_a_prior_makes_every_parameter_determined():
    fit = calibrate(
        static("medrue", MEDRUE_TRUTH), CalibrationOptions(free=PAPER.names, prior=True)
    )
    assert all(p.std is not None for p in fit.identified)
    tolerance = dict(zip(PAPER.names, PAPER.tolerance, strict=True))
    assert abs(fit["x0"].std / tolerance["x0"] - 1) < 1e-6  # the data says nothing of x0
    assert fit["mTool"].std < 0.1 * tolerance["mTool"]


def test_what_is_stated_is_where_the_fit_starts_and_what_is_held_stays():
    rec = static("ur5", UR5_TRUTH)
    stated = with_metadata(rec, tool=ToolInfo(mass=1.5, cog=(0.0, 0.0, 0.1)))
    fit = calibrate(stated, CalibrationOptions(hold=("tool.mass",)))
    assert "tool.mass" not in [p.name for p in fit.identified]
    assert fit.theta["tool.mass"] == 1.5
    assert fit["tool.cog.z"].nominal == 0.1


def test_real_poses_give_the_published_tool():
    """NTNU 2024, doi 10.5281/zenodo.11096791: 24 poses; the published mass is 0.932 kg."""
    fit = calibrate(real())
    assert fit.poses == 24
    assert fit["tool.mass"].value == pytest.approx(0.932, abs=0.0005)
    assert fit["tool.mass"].std == pytest.approx(0.0074, abs=0.0005)  # with a curve or a pull
    cog = [1e3 * fit[f"tool.cog.{a}"].value for a in "xyz"]
    assert cog == pytest.approx([0.3, 0.05, 43.9], abs=0.05)
    bias = [fit[f"sensor.bias.{c}"].value for c in ("fx", "fy", "fz")]
    assert bias == pytest.approx([9.08, -1.02, 9.98], abs=0.01)
    assert fit.residual_rms[:3] == pytest.approx([0.131, 0.047, 0.057], abs=0.001)
    assert fit.noise.source == "residual"


def test_the_real_bases_tilt_is_the_accelerometers():
    """Freed with a 3 × 3 gain, the tilt from forces agrees with the one from the accelerometer."""
    free = ("tool.mass", "tool.cog", "sensor.bias", "base.tilt", "sensor.matrix")
    fit = calibrate(real(), CalibrationOptions(free=free))
    told = np.array([fit["base.tilt.x"].value, fit["base.tilt.y"].value])
    std = np.array([fit["base.tilt.x"].std, fit["base.tilt.y"].std])
    wanted = np.deg2rad([-0.134, 0.203])  # of its own linear fit: see tests/diagnosis
    assert np.all(np.sign(told) == np.sign(wanted))
    assert np.all(np.abs(told - wanted) < 2 * std)
    assert np.abs(told).min() > std.max() * 0.9
    assert fit["tool.mass"].std is None  # a free gain takes it


@pytest.mark.parametrize(("axis", "angle"), [("z", 2.1), ("z", 3.0), ("x", 2.7), ("y", -2.9)])
def test_a_sensor_mounted_far_from_where_it_is_stated_is_found(axis, angle):
    still = {k: v for k, v in UR5_TRUTH.items() if "mount" not in k}
    turned = f"mount.rotation.{axis}"
    fit = calibrate(static("ur5", still | {turned: angle}))
    for name, value in (still | {turned: angle}).items():
        assert fit[name].value == pytest.approx(value, abs=1e-9), name
    assert fit.converged and fit.residual_rms.max() < 1e-11


def test_saturated_rows_are_left_out_and_another_status_is_told():
    rec = static("ur5", UR5_TRUTH, samples=4, noise=WHITE)
    bad = (np.arange(len(rec)) >= 40) & (np.arange(len(rec)) < 44)
    columns = {"fx": np.where(bad, 130.0, rec.columns["fx"]), "status": bad.astype(np.uint32)}
    fit = calibrate(with_columns(rec, columns))
    assert fit.left_out == 4
    assert "4 saturated rows were left out" in fit.status
    assert abs(fit["sensor.bias.fx"].value - 3.0) < 5 * fit["sensor.bias.fx"].std
    device = with_columns(with_metadata(rec, source="ur_rtde"), {"status": bad.astype(np.uint32)})
    fit = calibrate(device)
    assert fit.left_out == 0
    assert "status word is not 0 in 4 of the rows used" in fit.status


SAME = {f"q{j}": np.full(100, 0.1) for j in range(1, 7)}
ALL = np.ones(100, dtype=np.uint32)
REFUSED = {
    "opposite": (lambda r: opposite(r, CHANNELS), {}, r"comes out as -1.42 kg.*opposite sign"),
    "frozen": (lambda r: with_columns(r, SAME), {}, "joints are frozen"),
    "few poses": (lambda r: with_rows(r, slice(2)), {}, "2 poses give 12 readings, too few for 13"),
    "no parameter": (lambda r: r, {"free": ("tool.mas",)}, "did you mean 'tool.mass'"),
    "none free": (lambda r: r, {"free": ("tool.mass",), "hold": ("tool.mass",)}, "no parameter is"),
    "saturated": (lambda r: with_columns(r, {"status": ALL}), {}, "every row is saturated"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_data_cannot_support_is_refused(case):
    make, options, words = REFUSED[case]
    with pytest.raises((CalibrationError, ParameterError, RecordingError), match=words):
        calibrate(make(static("ur5", UR5_TRUTH)), CalibrationOptions(**options))


def test_every_registered_robot_without_a_model_calibrates_from_orientations():
    """The same data, given once as joints and once as orientations, gives the same tool."""
    rec = static("ur5", {k: v for k, v in UR5_TRUTH.items() if "mount" not in k})
    robot = wb.load("robots", "ur5")
    rotations = robot.sensor_pose(rec.q, robot.parameters.nominal)[0]
    q = np.stack([quaternion(rotation) for rotation in rotations])
    columns = {k: v for k, v in rec.columns.items() if not k.startswith("q")}
    columns |= by_name(("qw", "qx", "qy", "qz"), q)
    turned = SensorInfo(pose_flange=(0.0, 0.0, 0.0, 0.7071068, 0.0, 0.0, 0.7071068))
    some = replace(rec.metadata, robot="some-arm", sensor=turned)  # q is the sensor's already
    fit = calibrate(Recording(some, columns))
    also = {f"q{j}": rec.columns[f"q{j}"] for j in range(1, 7)}  # joints without a model
    assert calibrate(Recording(some, columns | also)).tool == fit.tool
    assert fit["tool.mass"].value == pytest.approx(1.42, abs=1e-9)
    assert fit["tool.cog.z"].value == pytest.approx(0.083, abs=1e-9)


def test_a_channel_whose_residual_is_swallowed_keeps_its_noise():
    """Six poses, 55 parameters: the torques fit exactly, which says nothing of their noise."""
    options = CalibrationOptions(free=("candidates", "sensor.bias"), prior=True)
    for seed in range(3):
        how = {"poses": 6, "samples": 100, "noise": WHITE, "wander": 0.3}
        fit = calibrate(static("medrue", {}, seed=seed, **how), options)
        assert fit.noise.inflated
        assert (fit.noise.scatter / fit.noise.expected).min() > 0.02


UR5 = wb.Model.of(wb.load("robots", "ur5"))


def test_an_interval_of_a_stated_noise_is_normal_and_of_a_found_one_student_s():
    stated = calibrate(static("ur5", UR5_TRUTH, poses=30, noise=WHITE))
    for p in stated.identified:
        assert p.interval95 == pytest.approx(1.959964 * p.std)
    repeated = calibrate(static("ur5", UR5_TRUTH, poses=6, samples=4, noise=WHITE))
    assert repeated.noise.source == "repeats"
    for p in repeated.identified:  # 6 · 3 degrees of freedom
        assert p.interval95 == pytest.approx(2.100922 * p.std)
    assert (repeated.poses, repeated.rows) == (6, 24)


def test_a_tool_weighs_something_and_touches_are_no_recording_under_gravity():
    check_mass(1e-6)
    for mass in (0.0, -0.5, float("nan")):
        with pytest.raises(CalibrationError, match="opposite sign"):
            check_mass(mass)
    rec = static("ur5", UR5_TRUTH, poses=12)
    with pytest.raises(CalibrationError, match="loss 'cubic' is not one of linear, huber"):
        calibrate(rec, CalibrationOptions(loss="cubic"))
    touching = dict(rec.columns) | dict.fromkeys(POINT, np.zeros(12))
    with pytest.raises(CalibrationError, match="these are touches"):
        calibrate(Recording(rec.metadata, touching))
    with pytest.raises(RecordingError, match="px without the rest of px py pz"):
        Recording(rec.metadata, dict(rec.columns) | {"px": np.zeros(12)})
    bare = {k: v for k, v in touching.items() if not k.startswith("q")}
    with pytest.raises(CalibrationError, match="touches need joint columns"):
        Touches.of(SimpleNamespace(name="r", columns=bare, joints=()), 1e-4)


def test_the_status_says_how_far_to_trust_a_fit():
    one, explained = np.ones(6), "; the residual is what the noise of the repeats explains"

    def status(source="repeats", scatter=one, agreement=None, steps=1, converged=True):
        noise = FitNoise(one, source, 2.0 * one, scatter, one, 4.0, scatter is not one)
        solution = SimpleNamespace(steps=steps, converged=converged)
        return _status(solution, noise, [], SimpleNamespace(left_out=0, flagged=0), agreement)

    assert status() == "converged in 1 step" + explained
    assert status(steps=3) == "converged in 3 steps" + explained
    assert status(converged=False).startswith("not converged after 1 step: do not use these values")
    wide = status("stated", np.array([1.0, 2.0, 3.0, 4.0, 9.0, 6.0]))
    assert "up to 4.5 times what the stated noise explains" in wide
    assert status("residual").endswith("no stated noise: uncertainties follow the residual")
    assert status(agreement=Agreement(4, 1e-4, 2, 3.0, 0.5)) == status()
    doubtful = status(agreement=Agreement(4, 1e-4, 2, 6.0, 1e-6))
    assert "touch 2 (counted from 0) lies 6.0 standard deviations" in doubtful


def flickering(seed: int) -> Recording:
    """UR5 data with the Gamma's real noise: 60 poses of 0.6 s, one every 5 s."""
    rec = static("ur5", UR5_TRUTH, poses=60, samples=60, seed=seed)
    t = rec.columns["segment"] * 5.0 + (np.arange(len(rec)) % 60) / 100
    stream = NoiseStream(wb.load("sensors", "ati-gamma").noise, seed)
    return with_columns(rec, by_name(CHANNELS, stream.corrupt(t, rec.wrench)[0]) | {"t": t})


def of_robot(robot, truth, **how):
    return lambda seed: static(robot, truth, samples=20, noise=WHITE, seed=1000 + seed, **how)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("recorded", "truth", "seeds", "parameters"),
    [
        (of_robot("ur5", UR5_TRUTH, poses=60), UR5_TRUTH, 200, 13),
        (of_robot("medrue", MEDRUE_TRUTH), MEDRUE_TRUTH, 40, 27),
        # each hold off by twice the noise of one row: 60 × 20 rows are worth 60/(1/20 + 4) ≈ 15
        (of_robot("ur5", UR5_TRUTH, poses=60, wander=2.0), UR5_TRUTH, 60, 13),
        # the tz of the measured Gamma wanders most: its 3,600 rows fix a bias like 60 to 600 would
        (flickering, UR5_TRUTH, 30, 13),
    ],
    ids=["ur5", "medrue", "wander", "flicker"],
)
def test_ninety_five_percent_intervals_hold(request, recorded, truth, seeds, parameters):
    """200 seeds × 13 parameters; the share's own standard error is about 0.6 %."""
    kind, inside, total, effective = request.node.callspec.id, 0, 0, []
    for seed in range(seeds):
        fit = calibrate(recorded(seed))
        for p in fit.identified:
            inside += abs(p.value - truth.get(p.name, p.nominal)) <= p.interval95
            total += 1
        if kind == "flicker":
            assert fit.noise.inflated and fit.noise.effective[5] < 0.3 * fit.rows
        if kind == "wander":
            assert fit.noise.inflated and "slow wander" in fit.status
            effective.append(fit.noise.effective)
    assert total == seeds * parameters
    assert not effective or 7 < np.median(effective) < 30
    least, most = (0.9, 1.0) if kind == "flicker" else (0.93, 0.97)
    assert least <= inside / total <= most


@pytest.mark.parametrize("counts", [6e-5, 1.2e-4])
def test_counts_of_an_encoder_at_a_high_rate_take_a_wider_window(tmp_path, counts):
    plan = wb.multisine(wb.load("robots", "ur5"), 10.0, 500.0, 3)
    moved = driven(plan, tmp_path / "rec.parquet", noise="white", seed=5)
    q = {n: np.round(moved.columns[n] / counts) * counts for n in moved.joints}
    coarse = Recording(moved.metadata, {**moved.columns, **q}, moved.name)
    assert window_of(coarse) > window_of(moved)
    fine, fit = calibrate(moved), calibrate(coarse)
    for name in ("tool.mass", "tool.cog.x", "tool.cog.y", "tool.cog.z"):
        assert abs(fit[name].value - fine[name].value) < 1.0 * fine[name].std
    noise = 1e-3 * np.random.default_rng(0).standard_normal(len(moved))
    loud = {n: x + noise for n, x in q.items()}
    with pytest.raises(CalibrationError, match="is rough"):
        calibrate(Recording(moved.metadata, {**moved.columns, **loud}, moved.name))


def test_a_motion_with_gaps_is_fitted_by_its_pieces():
    sound = good("motion", 3)
    t = sound.recording.t
    cut = with_rows(sound.recording, ((t < 3.0) | (t > 3.4)) & ((t < 7.0) | (t > 7.05)))
    fit = calibrate(cut)
    assert fit.rows > 0.8 * len(t)
    for value in fit.identified:
        assert abs(value.value - sound.truth.get(value.name, value.nominal)) < 4.0 * value.std


@pytest.mark.parametrize("deriv", [0, 1, 2])
def test_joint_values_are_smoothed_as_savitzky_and_golay_do(deriv):
    course = np.cumsum(np.random.default_rng(deriv).standard_normal((90, 6)), axis=0)
    same = savgol_filter(course, 21, 5, deriv, 0.008, axis=0)
    assert np.allclose(smoothed(course, 21, deriv, 0.008), same, atol=1e-9 * np.abs(same).max())
