"""Fits of joint torques and currents: truths recovered, intervals that hold, honest refusals."""

import json

import loop_torques as loops
import numpy as np
import pytest
from arm_torques import NOISE, UR5, coloured, fourier, lugre, recording, torques

from wrenchbed.cli import main
from wrenchbed.data.column_map import read as read_map
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.efforts.configured import stated_drives
from wrenchbed.drives.base_parameters import base_parameters
from wrenchbed.drives.identify import calibrate_efforts
from wrenchbed.drives.inverse_dynamics import torque_regressor
from wrenchbed.errors import (
    CalibrationError,
    MapError,
    ParameterError,
    RecordingError,
)
from wrenchbed.physics.time_derivatives import Jet

COULOMB = np.array([8.0, 9.0, 7.0, 2.0, 1.5, 1.2])
VISCOUS = np.array([5.0, 6.0, 4.0, 1.0, 0.8, 0.7])
CONSTANT = np.array([13.0, 13.0, 12.0, 9.0, 9.0, 9.0])
MASS, COG = 1.9, (0.01, -0.006, 0.09)
TRUTH = {"tool.mass": MASS} | {f"tool.cog.{a}": c for a, c in zip("xyz", COG, strict=True)}
for _j in range(6):
    TRUTH |= {f"drive.coulomb.{_j + 1}": COULOMB[_j], f"drive.viscous.{_j + 1}": VISCOUS[_j],
              f"drive.offset.{_j + 1}": 0.0, f"drive.inertia.{_j + 1}": 0.1,
              f"drive.constant.{_j + 1}": CONSTANT[_j]}  # fmt: skip


def motion(seed, seconds=60.0):
    """Clock, joint values and torque (N, 6) with friction, no noise."""
    t, q, qd, qdd = fourier(np.random.default_rng(seed), seconds)
    theta = UR5.theta_of_tool(UR5.parameters.nominal.copy(), MASS, COG)
    return t, q, qd, torques(theta, q, qd, qdd) + COULOMB * np.sign(qd) + VISCOUS * qd


@pytest.fixture(scope="module")
def clean():
    return motion(3)


def noisy(effort, seed):
    return effort + NOISE * coloured(np.random.default_rng(seed), effort.shape)


def test_without_noise_the_truth_comes_out(clean):
    t, q, _, effort = clean
    fit = calibrate_efforts(recording(t, q, effort))
    for p in fit.identified:
        if p.name in TRUTH:
            assert p.value == pytest.approx(TRUTH[p.name], abs=2e-3), p.name
    assert fit["tool.mass"].value == pytest.approx(MASS, abs=1e-5)
    assert fit.refuted is None and all(e.explained > 0.99 for e in fit.joints)


@pytest.mark.parametrize(("prefix", "scale"), [("tau", np.ones(6)), ("i", CONSTANT)])
def test_noise_is_within_the_intervals_and_less_is_explained(clean, prefix, scale):
    t, q, _, effort = clean
    fit = calibrate_efforts(recording(t, q, noisy(effort, 4) / scale, prefix))
    off = [abs(p.value - TRUTH[p.name]) / p.std for p in fit.identified if p.name in TRUTH]
    assert len(off) == (34 if prefix == "i" else 28)
    assert np.sqrt(np.mean(np.square(off))) < 1.6 and max(off) < 5.0
    assert fit.unit == ("A" if prefix == "i" else "N·m")
    for e in fit.joints:
        assert e.left < e.held_out < 0.05 * e.measured


@pytest.mark.study
def test_intervals_hold_in_95_of_100_cases():
    """200 motions and loads; coloured noise."""
    held = []
    for seed in range(2000, 2200):
        t, q, _, effort = motion(seed)
        fit = calibrate_efforts(recording(t, q, noisy(effort, seed)))
        held += [abs(p.value - TRUTH[p.name]) <= p.interval95 for p in fit.identified
                 if p.name in TRUTH]  # fmt: skip
    assert 0.93 <= np.mean(held) <= 0.97


def test_friction_that_the_library_lacks_leaves_the_payload_and_is_not_hidden(clean):
    """LuGre bristles with a Stribeck dip: the payload holds, joint errors on held-out rows show."""
    t, q, qd, effort = clean
    body = effort - COULOMB * np.sign(qd) - VISCOUS * qd
    bristles = lugre(qd, 1.0 / 125.0, COULOMB, 1.5 * COULOMB, VISCOUS)
    fit = calibrate_efforts(recording(t, q, noisy(body + bristles, 5)))
    plain = calibrate_efforts(recording(t, q, noisy(effort, 5)))
    assert abs(fit["tool.mass"].value - MASS) < fit["tool.mass"].interval95
    worse = [a.held_out / b.held_out for a, b in zip(fit.joints, plain.joints, strict=True)]
    assert max(worse) > 1.2
    wider = [fit[f"drive.coulomb.{j}"].std / plain[f"drive.coulomb.{j}"].std for j in range(1, 7)]
    assert max(wider) > 1.2 and np.median(wider) > 1.0


def test_links_are_told_as_base_parameters(clean):
    t, q, _, effort = clean
    fit = calibrate_efforts(recording(t, q, noisy(effort, 6)), ["link", *FREE])
    assert any(p.name.startswith("link.6.") for p in fit.identified)
    assert all(e.explained > 0.95 for e in fit.joints)


FREE = ("drive.coulomb", "drive.viscous", "drive.offset")


@pytest.mark.parametrize(("robot", "count"), [(UR5, 36), (loops.MEDRUE, 43)])
def test_base_parameters_explain_all_torques_and_are_independent(robot, count):
    rng = np.random.default_rng(7)
    theta = robot.parameters.nominal
    base = base_parameters(robot, theta)
    at = robot.sample(50, rng)
    q = Jet(at, rng.normal(size=at.shape), rng.normal(size=at.shape))
    y = torque_regressor(robot, theta, q, np.array(robot.gravity)).reshape(300, -1)
    kept = y[:, base.columns]
    assert np.abs(kept @ base.grouping - y).max() < 1e-8
    singular = np.linalg.svd(kept / np.linalg.norm(kept, axis=0), compute_uv=False)
    assert singular[-1] > 1e-4 and np.linalg.matrix_rank(y, 1e-9 * np.abs(y).max()) == count
    assert len(base.names) == count
    phi = rng.normal(size=y.shape[1])
    found = np.linalg.lstsq(kept, y @ phi, rcond=None)[0]
    assert np.abs(found - base.grouping @ phi).max() < 1e-8


def test_the_opposite_sign_is_refused_and_forced(clean):
    t, q, _, effort = clean
    wrong = recording(t, q, -noisy(effort, 8) / CONSTANT, "i")
    with pytest.raises(CalibrationError, match=r"drive\.constant\.1 .* opposite sign"):
        calibrate_efforts(wrong)
    assert "opposite sign" in calibrate_efforts(wrong, force=True).refuted


def test_another_motion_than_the_torques_is_refused(clean):
    t, _, _, effort = clean
    other = motion(9)[1]
    with pytest.raises(CalibrationError, match="explains nothing on rows"):
        calibrate_efforts(recording(t, other, noisy(effort, 9)))


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        (lambda t, q, y: (t, q[:1].repeat(len(q), axis=0), y), CalibrationError, "needs a motion"),
        (lambda t, q, y: (t[:50], q[:50], y[:50]), CalibrationError, "50 rows"),
        (lambda t, q, y: (np.where(t > 3.0, t + 1.0, t), q, y), RecordingError, "row 376: 1.008"),
        (lambda t, q, y: (t, q, y * [1, 1, 1, 1, 0, 1]), CalibrationError, "'tau5' never changes"),
    ],
)
def test_what_cannot_be_fitted_is_named(clean, change, error, words):
    t, q, _, effort = clean
    with pytest.raises(error, match=words):
        calibrate_efforts(recording(*change(t, q, effort)))


def test_groups_are_checked(clean):
    t, q, _, effort = clean
    with pytest.raises(ParameterError, match=r"drive\.colomb: is none of"):
        calibrate_efforts(recording(t, q, effort), ["drive.colomb"])
    with pytest.raises(ParameterError, match=r"currents need drive\.constant"):
        calibrate_efforts(recording(t, q, effort, "i"), ["tool"])


def test_known_constants_make_currents_torques(clean, tmp_path):
    t, q, _, effort = clean
    seen = noisy(effort, 12)
    known = calibrate_efforts(recording(t, q, seen / CONSTANT, "i"), constants=CONSTANT)
    plain = calibrate_efforts(recording(t, q, seen))
    found = calibrate_efforts(recording(t, q, seen / CONSTANT, "i"))
    for a, b in zip(known.identified, plain.identified, strict=True):
        assert a.name == b.name and a.value == pytest.approx(b.value, rel=1e-9, abs=1e-12)
    assert known["tool.mass"].std < found["tool.mass"].std
    known.write(tmp_path / "fit.json")
    told = stated_drives(recording(t, q, seen / CONSTANT, "i"), tmp_path / "fit.json")
    assert told.of("drive.constant") == pytest.approx(CONSTANT)
    for constants, words in ((CONSTANT[:5], "give 6 numbers"), (-CONSTANT, "above 0")):
        with pytest.raises(ParameterError, match=words):
            calibrate_efforts(recording(t, q, seen, "i"), constants=constants)
    with pytest.raises(ParameterError, match="which need none"):
        calibrate_efforts(recording(t, q, seen), constants=CONSTANT)


@pytest.fixture(scope="module")
def looped():
    """Clock, motion and torques of MedRUE with its load, no noise."""
    t, q = loops.fourier(np.random.default_rng(3))
    return t, q, loops.torques(q)


LOOPED = {"tool.mass": loops.MASS} | {
    f"drive.{kind}.{j + 1}": values[j] for j in range(6) for kind, values in (
        ("coulomb", loops.COULOMB), ("viscous", loops.VISCOUS), ("offset", loops.OFFSET),
        ("inertia", loops.ROTOR), ("constant", loops.CONSTANT))
} | {f"tool.cog.{a}": c for a, c in zip("xyz", loops.COG, strict=True)}  # fmt: skip
EMPTY = {"mass": 0.365, "cog": [-0.015872, -0.038343, 0.1107]}
"""MedRUE's probe, which is not what it carries here."""


def test_of_closed_loops_without_noise_the_truth_comes_out(looped):
    t, q, effort = looped
    fit = calibrate_efforts(loops.recording(t, q, effort, tool=EMPTY))
    for name, value in LOOPED.items():
        if "constant" not in name:
            assert fit[name].value == pytest.approx(value, rel=2e-3, abs=2e-4), name
    assert [e.unit for e in fit.joints] == ["N", *["N·m"] * 5]
    units = {k: (fit[f"drive.{k}.1"].unit, fit[f"drive.{k}.2"].unit)
             for k in ("coulomb", "viscous", "inertia")}  # fmt: skip
    assert units == {"coulomb": ("N", "N·m"), "viscous": ("N·s/m", "N·m·s/rad"),
                     "inertia": ("kg", "kg·m²")}  # fmt: skip


@pytest.mark.parametrize(("prefix", "scale"), [("tau", np.ones(6)), ("i", loops.CONSTANT)])
def test_of_closed_loops_noise_is_within_the_intervals(looped, prefix, scale):
    t, q, effort = looped
    seen = effort + loops.NOISE * coloured(np.random.default_rng(4), effort.shape)
    fit = calibrate_efforts(loops.recording(t, q, seen / scale, prefix, tool=EMPTY))
    off = [abs(p.value - LOOPED[p.name]) / p.std for p in fit.identified if p.name in LOOPED]
    assert len(off) == (34 if prefix == "i" else 28)
    assert np.sqrt(np.mean(np.square(off))) < 1.6 and max(off) < 5.0
    assert all(e.left < e.held_out < 0.05 * e.measured for e in fit.joints)


def test_the_table_of_a_slide_has_its_units(looped, tmp_path, capsys):
    t, q, effort = looped
    seen = effort + loops.NOISE * coloured(np.random.default_rng(4), effort.shape)
    loops.recording(t, q, seen).write(tmp_path / "rec.parquet")
    assert main(["calibrate", str(tmp_path / "rec.parquet"), "--channels", "effort"]) == 0
    shown = capsys.readouterr().out
    assert "1: N·s/m" in shown and "1: kg" in shown and "unit" in shown
    assert all(len(line) <= 80 for line in shown.splitlines())


def test_links_of_closed_loops_are_told_as_base_parameters(looped):
    t, q, effort = looped
    names = ["link", *FREE, "drive.inertia"]
    fit = calibrate_efforts(loops.recording(t, q, effort, tool=EMPTY), names)
    assert all(e.explained > 0.999 for e in fit.joints)
    assert any(p.name.startswith("link.8.") for p in fit.identified)  # the wrist has the load


def test_the_verb_writes_a_fit_that_no_export_takes_for_one_of_the_wrench(clean, tmp_path, capsys):
    t, q, _, effort = clean
    path, out = tmp_path / "rec.parquet", tmp_path / "fit.json"
    recording(t, q, noisy(effort, 10)).write(path)
    assert Recording.read(path).effort == "tau" and not Recording.read(path).has_wrench
    assert main(["calibrate", str(path), "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    assert "drive.coulomb" in shown and "held-out rows" in shown
    raw = json.loads(out.read_text())
    assert raw["channels"] == "effort" and raw["unit"] == "N·m" and len(raw["joints"]) == 6
    assert raw["parameters"]["tool.mass"]["value"] == pytest.approx(MASS, abs=0.1)
    assert main(["export", str(out), "--to", "ur", "--out", str(tmp_path / "a.script")]) != 0
    assert "fit of joint efforts" in capsys.readouterr().err
    assert main(["calibrate", str(path), "--prior"]) != 0
    assert "--prior is for wrenches" in capsys.readouterr().err
    both = ["diagnose", str(path), "--channels", "wrench", "--out", str(tmp_path / "found")]
    assert main(both) != 0
    assert "has no wrench" in capsys.readouterr().err


def test_a_ur_rtde_file_of_currents_is_imported_and_fitted(clean, tmp_path):
    t, q, _, effort = clean
    current = noisy(effort, 11) / CONSTANT
    names = ["timestamp", *(f"actual_q_{j}" for j in range(6)),
             *(f"actual_current_{j}" for j in range(6))]  # fmt: skip
    table = np.column_stack([t, q, current])
    csv = tmp_path / "robot.csv"
    np.savetxt(csv, table, delimiter=",", header=",".join(names), comments="", fmt="%.9f")
    out = tmp_path / "rec.parquet"
    assert main(["import", str(csv), "--map", "ur-rtde-current", "--out", str(out)]) == 0
    made = Recording.read(out)
    assert made.effort == "i" and len(made) == len(t)
    assert made.metadata.sensor.noise_std is None  # of a wrench; this has none
    fit = calibrate_efforts(made)
    assert abs(fit["tool.mass"].value - MASS) < fit["tool.mass"].interval95


def test_a_map_of_some_joints_currents_is_no_effort(tmp_path):
    text = '[recording]\nrobot = "ur5"\nmode = "dynamic"\n[[file]]\nmatch = "*"\n[file.columns]\n'
    columns = ["t", *(f"q{j + 1}" for j in range(6)), *(f"i{j + 1}" for j in range(5))]
    units = {"t": "s", "q": "rad", "i": "A"}
    text += "".join(f'{c} = {{ column = "{c}", unit = "{units[c[0]]}" }}\n' for c in columns)
    (tmp_path / "map.toml").write_text(text)
    with pytest.raises(MapError, match="no column is mapped to fx"):
        read_map(tmp_path / "map.toml")


def test_what_is_divided_by_a_number_that_may_be_zero_is_not_told():
    """No load turns about the last axis: its currents show friction and no constant."""
    t, q, qd, qdd = fourier(np.random.default_rng(13))
    theta = UR5.theta_of_tool(UR5.parameters.nominal.copy(), 1e-4, (0.0, 0.0, 0.01))
    body = torques(theta, q, qd, qdd, armature=0.1 * np.array([1, 1, 1, 1, 1, 0]))
    seen = noisy(body + COULOMB * np.sign(qd) + VISCOUS * qd, 13) / CONSTANT
    tool = {"mass": 1e-4, "cog": [0.0, 0.0, 0.01], "inertia": [1e-6, 1e-6, 1e-6, 0, 0, 0]}
    fit = calibrate_efforts(recording(t, q, seen, "i", tool=tool))
    assert fit["drive.constant.6"].std is None and fit["drive.coulomb.6"].std is None
    assert fit["tool.cog.x"].std is None and fit["tool.mass"].std is not None
    assert fit["drive.constant.2"].std is not None
    assert "does not tell drive.constant.6" in fit.status and "link masses" in fit.status
