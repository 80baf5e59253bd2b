"""Calibration recovers known truths, says how sure it is, and says what it cannot tell."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from simulated import MEDRUE_TRUTH, UR5_TRUTH, WHITE, static
from wrenchbed import registry
from wrenchbed.calibration.calibrate import CalibrationOptions, calibrate
from wrenchbed.data import column_map
from wrenchbed.data.import_files import import_files
from wrenchbed.data.metadata import SensorInfo, ToolInfo
from wrenchbed.data.recording import Recording
from wrenchbed.errors import CalibrationError, ParameterError, RecordingError
from wrenchbed.robots.medrue.kinematics import IDENTIFIED, PAPER

DATA = Path(__file__).parents[1] / "data"


def ntnu() -> Recording:
    mapping = column_map.read(DATA / "ntnu_kuka_ati_gamma" / "static.toml")
    file = DATA / "ntnu_kuka_ati_gamma" / "0-calibration_fts-accel.csv"
    recording = import_files([file], mapping).recording
    bare = replace(recording.metadata, sensor=SensorInfo("ati-gamma"))  # as if no noise were stated
    return Recording(bare, recording.columns)


def test_ur5_is_recovered_to_rounding_without_noise():
    fit = calibrate(static("ur5", UR5_TRUTH))
    assert fit.converged
    for name, value in UR5_TRUTH.items():
        assert abs(fit[name].value - value) < 1e-9, name
    assert fit.residual_rms.max() < 1e-11
    assert abs(fit.tool["mass"] - 1.42) < 1e-9


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_medrue_is_recovered_to_rounding_without_noise(seed):
    fit = calibrate(static("medrue", MEDRUE_TRUTH, seed=seed))
    assert fit.converged
    assert fit.iterations <= 7
    assert fit.observability.rank == 27
    assert [p.name for p in fit.identified] == [n for n in PAPER.names if n in IDENTIFIED]
    for name in IDENTIFIED:
        assert abs(fit[name].value - MEDRUE_TRUTH[name]) < 1e-9, name
    assert len(fit.observability.redundancies) + len(fit.observability.no_effect) == 22


def test_all_of_medrue_free_fits_as_well_and_says_which_values_mean_nothing_alone():
    fit = calibrate(static("medrue", MEDRUE_TRUTH), CalibrationOptions(free=PAPER.names))
    assert fit.residual_rms.max() < 1e-11
    assert fit["xS"].std is None
    assert fit["mTool"].std is not None
    assert abs(fit["mTool"].value - MEDRUE_TRUTH["mTool"]) < 1e-9
    total = fit["d41"].value + fit["d42"].value
    wanted = MEDRUE_TRUTH["d41"] + MEDRUE_TRUTH["d42"]
    scale = fit["L11"].value / MEDRUE_TRUTH["L11"]
    assert abs(total / wanted - scale) < 0.02  # up to the shifts, the free scale alone
    assert "fixed only in combination" in fit.status


def test_a_prior_makes_every_parameter_determined():
    fit = calibrate(
        static("medrue", MEDRUE_TRUTH), CalibrationOptions(free=PAPER.names, prior=True)
    )
    assert all(p.std is not None for p in fit.identified)
    tolerance = dict(zip(PAPER.names, PAPER.tolerance, strict=True))
    assert abs(fit["x0"].std / tolerance["x0"] - 1) < 1e-6  # the data says nothing of x0
    assert fit["mTool"].std < 0.1 * tolerance["mTool"]


def test_noise_is_what_the_repeats_show():
    fit = calibrate(static("ur5", UR5_TRUTH, samples=50, noise=WHITE))
    assert fit.noise.source == "repeats"
    assert not fit.noise.inflated
    assert np.abs(fit.noise.row / WHITE - 1).max() < 0.05
    assert np.allclose(fit.noise.effective, 5000)


def test_stated_noise_stands_in_for_repeats():
    fit = calibrate(static("ur5", UR5_TRUTH, noise=WHITE))
    assert fit.noise.source == "stated"
    unstated = static("ur5", UR5_TRUTH, noise=WHITE)
    bare = Recording(replace(unstated.metadata, sensor=SensorInfo()), unstated.columns)
    assert calibrate(bare).noise.source == "residual"


def test_the_recordings_own_order_and_units_do_not_matter():
    a = static("ur5", UR5_TRUTH, noise=WHITE, samples=5)
    order = np.random.default_rng(0).permutation(100)
    rows = (order[:, None] * 5 + np.arange(5)).ravel()
    shuffled = {k: v[rows] for k, v in a.columns.items() if k != "t"} | {"t": a.t}
    b = Recording(a.metadata, shuffled)
    first, second = calibrate(a), calibrate(b)
    for p in first.identified:
        assert abs(p.value - second[p.name].value) < 1e-6 * p.std


def test_what_is_stated_is_where_the_fit_starts_and_what_is_held_stays():
    rec = static("ur5", UR5_TRUTH)
    stated = replace(rec.metadata, tool=ToolInfo(mass=1.5, cog=(0.0, 0.0, 0.1)))
    fit = calibrate(Recording(stated, rec.columns), CalibrationOptions(hold=("tool.mass",)))
    assert "tool.mass" not in [p.name for p in fit.identified]
    assert fit.theta["tool.mass"] == 1.5
    assert fit["tool.cog.z"].nominal == 0.1


def test_a_robust_loss_shrugs_off_outliers():
    rec = static("ur5", UR5_TRUTH, noise=WHITE, samples=1, seed=3)
    wild = {k: v.copy() for k, v in rec.columns.items()}
    wild["fx"][::9] += 4.0
    wild["ty"][::7] -= 0.5
    bad = Recording(rec.metadata, wild)
    error = {}
    for loss in ("linear", "huber", "student"):
        fit = calibrate(bad, CalibrationOptions(loss=loss, force=loss == "linear"))
        error[loss] = abs(fit["sensor.bias.fx"].value - 3.0) + abs(
            fit["sensor.bias.ty"].value + 0.2
        )
    assert error["huber"] < 0.3 * error["linear"]
    assert error["student"] < 0.3 * error["linear"]


def test_real_poses_give_the_published_tool():
    """NTNU 2024, doi 10.5281/zenodo.11096791: 24 poses; the published mass is 0.932 kg."""
    fit = calibrate(ntnu())
    assert fit.poses == 24
    assert fit["tool.mass"].value == pytest.approx(0.932, abs=0.0005)
    assert fit["tool.mass"].std == pytest.approx(0.0036, abs=0.0005)  # its residual follows poses
    cog = [1e3 * fit[f"tool.cog.{a}"].value for a in "xyz"]
    assert cog == pytest.approx([0.3, 0.05, 43.9], abs=0.05)
    bias = [fit[f"sensor.bias.{c}"].value for c in ("fx", "fy", "fz")]
    assert bias == pytest.approx([9.08, -1.02, 9.98], abs=0.01)
    assert fit.residual_rms[:3] == pytest.approx([0.131, 0.047, 0.057], abs=0.001)
    assert fit.noise.source == "residual"


def test_the_real_bases_tilt_is_the_accelerometers():
    """Freed with a 3 × 3 gain, the tilt from forces agrees with the one from the accelerometer."""
    rec = ntnu()
    free = ("tool.mass", "tool.cog", "sensor.bias", "base.tilt", "sensor.matrix")
    fit = calibrate(rec, CalibrationOptions(free=free))
    told = np.array([fit["base.tilt.x"].value, fit["base.tilt.y"].value])
    std = np.array([fit["base.tilt.x"].std, fit["base.tilt.y"].std])
    wanted = accelerometer_tilt(rec)
    assert np.rad2deg(wanted) == pytest.approx([-0.134, 0.203], abs=0.01)
    assert np.all(np.sign(told) == np.sign(wanted))
    assert np.all(np.abs(told - wanted) < 2 * std)
    assert np.abs(told).min() > std.max() * 0.9
    assert fit["tool.mass"].std is None  # a free gain takes it


def accelerometer_tilt(rec: Recording) -> np.ndarray:
    """Small rotation of gravity in the base [rad], its own linear fit: a = A R'(g + α × g) + b."""
    a = np.stack([rec.columns[c] for c in ("ax", "ay", "az")], axis=-1)
    g = np.array(rec.metadata.gravity)
    tilt = np.zeros(2)
    for _ in range(20):
        seen = (g + np.cross([*tilt, 0.0], g)) @ rec.rotation
        design = np.column_stack([seen, np.ones(len(seen))])
        gain = np.linalg.lstsq(design, a, rcond=None)[0]
        rest = a - design @ gain
        columns = []
        for axis in ([1.0, 0, 0], [0, 1.0, 0]):
            turn = (np.cross(axis, g) @ rec.rotation) @ gain[:3]
            turn = turn - design @ np.linalg.lstsq(design, turn, rcond=None)[0]
            columns.append(turn.ravel())
        tilt = tilt + np.linalg.lstsq(np.column_stack(columns), rest.ravel(), rcond=None)[0]
    return tilt


@pytest.mark.parametrize(("axis", "angle"), [("z", 2.1), ("z", 3.0), ("x", 2.7), ("y", -2.9)])
def test_a_sensor_mounted_far_from_where_it_is_stated_is_found(axis, angle):
    still = {k: v for k, v in UR5_TRUTH.items() if "mount" not in k}
    turned = f"mount.rotation.{axis}"
    fit = calibrate(static("ur5", still | {turned: angle}))
    assert fit[turned].value == pytest.approx(angle, abs=1e-9)
    assert fit["tool.mass"].value == pytest.approx(1.42, abs=1e-9)


def test_saturated_rows_are_left_out_and_said():
    rec = static("ur5", UR5_TRUTH, samples=4, noise=WHITE)
    status = np.zeros(len(rec), dtype=np.uint32)
    columns = {k: v.copy() for k, v in rec.columns.items()}
    columns["fx"][40:44] = 130.0
    status[40:44] = 1
    fit = calibrate(Recording(rec.metadata, columns | {"status": status}))
    assert fit.left_out == 4
    assert "4 saturated rows were left out" in fit.status
    assert abs(fit["sensor.bias.fx"].value - 3.0) < 5 * fit["sensor.bias.fx"].std


def test_a_real_devices_status_word_is_told_but_drops_nothing():
    rec = static("ur5", UR5_TRUTH, noise=WHITE)
    measured = Recording(replace(rec.metadata, source="ur_rtde"), rec.columns)
    fit = calibrate(edited(measured, status=(np.arange(100) < 3).astype(np.uint32)))
    assert fit.left_out == 0
    assert "status word is not 0 in 3 of the rows used" in fit.status


def edited(rec: Recording, **columns) -> Recording:
    return Recording(rec.metadata, dict(rec.columns) | columns)


def test_what_data_cannot_support_is_refused():
    rec = static("ur5", UR5_TRUTH)
    flipped = edited(rec, **{c: -rec.columns[c] for c in ("fx", "fy", "fz", "tx", "ty", "tz")})
    with pytest.raises(CalibrationError, match=r"mass comes out as -1.42 kg.*opposite sign"):
        calibrate(flipped)
    same = edited(rec, **{f"q{j}": np.full(100, 0.1) for j in range(1, 7)})
    with pytest.raises(CalibrationError, match="joints are frozen"):
        calibrate(same)
    with pytest.raises(CalibrationError, match="2 poses give 12 readings, too few for 13"):
        calibrate(static("ur5", UR5_TRUTH, poses=2))
    with pytest.raises(ParameterError, match="did you mean 'tool.mass'"):
        calibrate(rec, CalibrationOptions(free=("tool.mas",)))
    with pytest.raises(CalibrationError, match="no parameter is free"):
        calibrate(rec, CalibrationOptions(free=("tool.mass",), hold=("tool.mass",)))
    with pytest.raises(CalibrationError, match="every row is saturated"):
        calibrate(edited(rec, status=np.ones(100, dtype=np.uint32)))


def test_a_recording_of_another_robot_is_refused():
    rec = static("ur5", UR5_TRUTH)
    wrong = Recording(replace(rec.metadata, robot="medrue"), rec.columns)
    with pytest.raises(RecordingError, match=r"robot 'medrue': row \d+: "):
        calibrate(wrong)
    unknown = Recording(replace(rec.metadata, robot="kuka"), rec.columns)
    with pytest.raises(RecordingError, match="no robot 'kuka' here"):
        calibrate(unknown)
    degrees = {f"q{j}": np.rad2deg(rec.columns[f"q{j}"]) for j in range(1, 7)}
    with pytest.raises(RecordingError, match="is it in degrees"):
        calibrate(edited(rec, **degrees))


def test_the_fit_is_json_that_states_units_and_ranks(tmp_path):
    fit = calibrate(static("medrue", MEDRUE_TRUTH))
    fit.write(tmp_path / "fit.json")
    raw = json.loads((tmp_path / "fit.json").read_text())
    assert raw["rank"] == 27
    assert raw["parameters"]["L11"]["unit"] == "m"
    assert raw["parameters"]["L11"]["value"] == pytest.approx(0.40073, abs=1e-9)
    assert any("d41 and d42" in r["sentence"] for r in raw["redundancies"])
    assert len(raw["correlation"]["matrix"]) == 27


def test_every_registered_robot_without_a_model_calibrates_from_orientations():
    """The same data, given once as joints and once as orientations, gives the same tool."""
    rec = static("ur5", {k: v for k, v in UR5_TRUTH.items() if "mount" not in k})
    robot = registry.load("robots", "ur5")
    from wrenchbed.physics.rotations import quaternion

    q = quaternion(robot.sensor_pose(rec.q, robot.parameters.nominal)[0])
    columns = {k: v for k, v in rec.columns.items() if not k.startswith("q")}
    columns |= dict(zip(("qw", "qx", "qy", "qz"), q.T, strict=True))
    turned = SensorInfo(pose_flange=(0.0, 0.0, 0.0, 0.7071068, 0.0, 0.0, 0.7071068))
    some = replace(rec.metadata, robot="some-arm", sensor=turned)  # q is the sensor's already
    fit = calibrate(Recording(some, columns))
    also = {f"q{j}": rec.columns[f"q{j}"] for j in range(1, 7)}  # joints without a model
    assert calibrate(Recording(some, columns | also)).tool == fit.tool
    assert fit["tool.mass"].value == pytest.approx(1.42, abs=1e-9)
    assert fit["tool.cog.z"].value == pytest.approx(0.083, abs=1e-9)


def test_a_channel_whose_residual_is_swallowed_keeps_its_noise():
    """Six poses, 55 parameters: the torques fit exactly, which says nothing of their noise."""
    recordings = [
        static("medrue", {}, poses=6, samples=100, noise=WHITE, wander=0.3, seed=seed)
        for seed in range(3)
    ]
    for recording in recordings:
        fit = calibrate(
            recording, CalibrationOptions(free=("candidates", "sensor.bias"), prior=True)
        )
        assert fit.noise.inflated
        assert (fit.noise.scatter / fit.noise.expected).min() > 0.02
