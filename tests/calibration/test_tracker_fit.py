"""Geometry and compliances from a tracker's readings of an arm in plain numpy."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import wrenchbed as wb
from plain_ur5 import poses
from tracked_ur5 import TrackedUr5
from wrenchbed.diagnosis.diagnose import diagnose
from wrenchbed.errors import CalibrationError, ExportError

UR5 = wb.load("robots", "ur5")
RIGID = wb.Options(hold=("compliance.q?",))


def predicted(fit, q):
    """Places (N, 3) of the target in the tracker's axes, by a rigid fit."""
    theta = np.array([fit.theta[name] for name in UR5.parameters.names])
    rotation, position = UR5.sensor_pose(q, theta)
    turn, shift, target = (
        np.array([fit.stand[f"{name}.{a}"] for a in "xyz"])
        for name in ("tracker.rotation", "tracker.position", "target.position")
    )
    return (position + rotation @ target) @ Rotation.from_rotvec(turn).as_matrix().T + shift


def rms(error):
    return float(np.sqrt((error**2).sum(axis=1).mean()))


def test_27_wrong_numbers_are_held_out_as_well_as_noise_allows():
    """Over sixteen arms: the error where nothing was measured, beside the Cramér–Rao bound."""
    square = []
    for seed in range(16):
        rng = np.random.default_rng(seed)
        arm = TrackedUr5.anyhow(rng)
        fit, q = wb.calibrate_tracker(arm.recording(seed), RIGID), poses(300, rng)
        bound = fit.accuracy * arm.noise / fit.noise  # at the true noise
        square.append((rms(predicted(fit, q) - arm.places(q)) / bound) ** 2)
        assert fit.held_out < 1.25 * fit.bound and fit.before > 10.0 * fit.held_out
        assert 0.8 < fit.noise / arm.noise < 1.2
    assert np.sqrt(np.mean(square)) < 1.1


def slopes_in_plain_numpy(q):
    """Slopes (3 N, 33) [m] of places by 24 numbers of the arm, target, and the tracker's stand."""

    def places(x):
        arm = TrackedUr5(x[:24].reshape(4, 6), target=tuple(x[24:27]), turn=tuple(x[27:30]))
        return arm.places(q) + x[30:]

    middle = np.concatenate([np.zeros(24), TrackedUr5.target, TrackedUr5.turn, np.zeros(3)])
    steps = 1e-5 * np.eye(33)
    return np.stack([(places(middle + h) - places(middle - h)).ravel() / 2e-5 for h in steps], 1)


@pytest.mark.slow
def test_planned_poses_tell_more_than_random_ones():
    """24 poses leave two thirds of the variance of places, by slopes of plain numpy."""
    planned = wb.for_tracker(UR5, 24, 2000, seed=0)
    few, again = (wb.for_tracker(UR5, 8, 200, seed=0).q for _ in range(2))
    assert np.array_equal(few, again)
    everywhere = slopes_in_plain_numpy(UR5.sample(150, np.random.default_rng(99)))

    def variance(q):
        known = slopes_in_plain_numpy(q) / 5e-5
        covariance = np.linalg.inv(known.T @ known + np.eye(33))  # 1 rad and 1 m before
        return float(np.einsum("ik,kl,il->", everywhere, covariance, everywhere))

    random = [variance(UR5.sample(24, np.random.default_rng(seed))) for seed in range(5)]
    assert variance(planned.q) < 0.7 * np.mean(random) and variance(planned.q) < 0.8 * min(random)


def test_numbers_come_out_within_their_uncertainty_and_sums_alone_where_axes_are_parallel():
    arm = TrackedUr5.anyhow(np.random.default_rng(5))
    fit = wb.calibrate_tracker(arm.recording(5), RIGID)
    zeros, twists, lengths, rises = arm.wrong
    truth = {f"dq{j + 1}": zeros[j] for j in range(1, 5)}
    truth |= {f"a{j + 1}": lengths[j] for j in range(5)} | {"d5": rises[4]}
    truth |= {f"alpha{j + 1}": twists[j] for j in range(5)}
    sigmas = [(fit[n].value - fit[n].nominal - x) / fit[n].std for n, x in truth.items()]
    assert np.abs(sigmas).max() < 4.0 and np.mean(np.square(sigmas)) < 2.5
    untold = {p.name for p in fit.identified if p.std is None}
    assert untold == {"d1", "dq1", "d2", "d3", "d4", "a6", "d6", "alpha6", "dq6"}
    assert any("d2 and d" in text for text in fit.cannot_tell)
    sum_of_rises = sum(fit[f"d{k}"].value - fit[f"d{k}"].nominal for k in (2, 3, 4))
    assert sum_of_rises == pytest.approx(rises[1:4].sum(), abs=1e-4)


def test_a_parallel_axis_that_leans_about_y_is_fitted_and_named():
    """Denavit and Hartenberg's twist turns about x alone: without β held-out places are 6 × off."""
    recording = TrackedUr5(lean=1e-3).recording(3, rows=4)
    fit = wb.calibrate_tracker(recording, RIGID)
    assert abs(fit["beta2"].value - 1e-3) < 4.0 * fit["beta2"].std < 4e-4
    assert fit.held_out < 1.25 * fit.bound
    (only,) = diagnose(recording).diagnosis.which
    assert (only["effect"], only["elements"]) == ("link.length", ["beta2"])


def test_a_prior_keeps_few_poses_from_wandering():
    arm = TrackedUr5.anyhow(np.random.default_rng(7))
    few = arm.recording(7, count=11)
    with pytest.raises(CalibrationError, match="too few for"):
        wb.calibrate_tracker(few)
    fit = wb.calibrate_tracker(few, wb.Options(prior=True))
    assert fit.held_out < fit.before
    assert all(p.std is not None for p in fit.identified)


def test_places_along_a_line_leave_the_trackers_turn_free():
    arm = replace(TrackedUr5.anyhow(np.random.default_rng(1)), noise=2e-5)
    rng, rec = np.random.default_rng(3), arm.recording(3)
    q = poses(1, rng)[0] + np.linspace(-0.3, 0.3, 60)[:, None] * [0, 1, -2, 1, 0, 0]
    read = arm.places(q) + arm.noise * rng.standard_normal((60, 3))
    line = {f"q{j + 1}": q[:, j] for j in range(6)} | dict(
        zip(("mx", "my", "mz"), read.T, strict=True)
    )
    rec = replace(rec, columns=rec.columns | line)
    with pytest.raises(CalibrationError, match="leave the tracker's turn free .* not converged"):
        wb.calibrate_tracker(rec, wb.Options(prior=True))


def test_columns_that_no_tracker_made_are_refused():
    arm = TrackedUr5()
    good = arm.recording(8)
    rng = np.random.default_rng(8)
    noise = {c: rng.standard_normal(len(good)) for c in ("mx", "my", "mz")}
    spoiled = wb.Recording(good.metadata, {**good.columns, **noise}, good.name)
    with pytest.raises(CalibrationError, match="do not follow this arm"):
        wb.calibrate_tracker(spoiled)
    without = {k: v for k, v in good.columns.items() if k not in noise}
    forces = {c: np.zeros(len(good)) for c in ("fx", "fy", "fz", "tx", "ty", "tz")}
    with pytest.raises(CalibrationError, match="no columns mx my mz"):
        wb.calibrate_tracker(wb.Recording(good.metadata, {**without, **forces}, good.name))


def test_the_fit_is_exported_as_a_simulator_and_never_as_a_load(tmp_path):
    give = (0.0, 1 / 1e4, 0.0, 0.0, 0.0, 0.0)
    arm = TrackedUr5(wrong=TrackedUr5.anyhow(np.random.default_rng(9)).wrong, give=give)
    fit = wb.calibrate_tracker(arm.recording(9), wb.Options(hold=("compliance.q[3-6]",)))
    assert "diagnose" in wb.calibrate_tracker(arm.recording(9, rows=4), RIGID).status
    soft = fit["compliance.q2"]
    assert abs(soft.value - give[1]) < 4.0 * soft.std < give[1]
    fit.write(tmp_path / "fit.json")
    twin = wb.calibrated_twin(tmp_path / "fit.json")
    assert [a.effect.name for a in twin.active] == ["joint.compliance"]
    assert twin.active[0].values["compliance.q2"] == fit["compliance.q2"].value
    assert twin.robot_theta[UR5.parameters.index("dq2")] == fit["dq2"].value
    with pytest.raises(ExportError, match="a fit of a tracker's readings"):
        wb.load_numbers(tmp_path / "fit.json")
    raw = json.loads((tmp_path / "fit.json").read_text(encoding="utf-8"))
    (tmp_path / "fit.json").write_text(json.dumps(raw | {"refuted": "by hand"}), encoding="utf-8")
    with pytest.raises(ExportError, match="by hand"):
        wb.calibrated_twin(tmp_path / "fit.json")
