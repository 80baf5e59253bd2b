"""Fits of joint torques and currents: truths recovered, intervals that hold, honest refusals."""

import json
import re
from dataclasses import dataclass

import arm_torques as arm
import loop_torques as loops
import numpy as np
import pytest
from arm_torques import COULOMB, MASS, UR5, VISCOUS, coloured, fourier, torques

from wrenchbed.cli import main
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.efforts.stated_drives import stated_drives
from wrenchbed.drives.base_parameters import BaseParameters
from wrenchbed.drives.identify import calibrate_efforts
from wrenchbed.drives.joint_least_squares import FOLDS, Problem, parts, solve
from wrenchbed.drives.signals import cutoff_of
from wrenchbed.errors import CalibrationError, ParameterError, RecordingError
from wrenchbed.physics.taylor_jets import Jet
from wrenchbed.robots.inverse_dynamics import torque_regressor

CONSTANT = np.array([13.0, 13.0, 12.0, 9.0, 9.0, 9.0])
TOOL = ("tool.mass", "tool.cog.x", "tool.cog.y", "tool.cog.z")
FREE = ("drive.coulomb", "drive.viscous", "drive.offset")


@dataclass(frozen=True, eq=False)
class Motion:
    """Clock, joint values and torques (N, 6) without noise, and how they are recorded."""

    t: np.ndarray
    q: Jet
    effort: np.ndarray
    truth: dict
    looped: bool = False

    @property
    def constant(self):
        return loops.CONSTANT if self.looped else CONSTANT

    def recording(self, effort=None, prefix="tau", **more):
        effort = self.effort if effort is None else effort
        if self.looped:
            return loops.recording(self.t, self.q, effort, prefix, tool=loops.PROBE)
        return arm.recording(self.t, self.q.v, effort, prefix, **more)

    def noisy(self, seed):
        noise = loops.NOISE if self.looped else arm.NOISE
        return self.effort + noise * coloured(np.random.default_rng(seed), self.effort.shape)


def motion(seed):
    t, q = fourier(np.random.default_rng(seed))
    effort = torques(q) + COULOMB * np.sign(q.d) + VISCOUS * q.d
    drives = {"coulomb": COULOMB, "viscous": VISCOUS, "offset": 0.0, "inertia": arm.ROTOR}
    true = dict(zip(TOOL, (MASS, *arm.COG), strict=True))
    return Motion(t, q, effort, true | arm.by_joint(constant=CONSTANT, **drives))


@pytest.fixture(scope="module")
def clean():
    return motion(3)


@pytest.fixture(scope="module")
def looped():
    t, q = loops.fourier(np.random.default_rng(3))
    true = dict(zip(TOOL, (loops.MASS, *loops.COG), strict=True)) | loops.DRIVES
    constant = arm.by_joint(constant=loops.CONSTANT)
    return Motion(t, q, loops.torques(q), true | constant, looped=True)


@pytest.fixture(params=["clean", "looped"])
def either(request):
    return request.getfixturevalue(request.param)


def test_without_noise_the_truth_comes_out(either):
    fit = calibrate_efforts(either.recording())
    for p in fit.identified:
        if p.name in either.truth:
            assert p.value == pytest.approx(either.truth[p.name], rel=2e-3, abs=2e-3), p.name
    assert fit["tool.mass"].value == pytest.approx(either.truth["tool.mass"], abs=1e-5)
    assert fit.refuted is None and all(e.explained > 0.99 for e in fit.joints)


def test_a_slide_has_units_of_its_own(looped):
    fit = calibrate_efforts(looped.recording(looped.noisy(4)))
    assert [e.unit for e in fit.joints] == ["N", *["N·m"] * 5]
    units = {k: (fit[f"drive.{k}.1"].unit, fit[f"drive.{k}.2"].unit) for k in loops.GROUPS}
    assert units == {
        "coulomb": ("N", "N·m"),
        "viscous": ("N·s/m", "N·m·s/rad"),
        "offset": ("N", "N·m"),
        "inertia": ("kg", "kg·m²"),
    }


@pytest.mark.parametrize("prefix", ["tau", "i"])
def test_noise_is_within_the_intervals_and_less_is_explained(either, prefix):
    scale = either.constant if prefix == "i" else 1.0
    fit = calibrate_efforts(either.recording(either.noisy(4) / scale, prefix))
    off = [abs(p.value - true) / p.std for p in fit.identified
           if (true := either.truth.get(p.name)) is not None]  # fmt: skip
    assert len(off) == (34 if prefix == "i" else 28)
    assert np.sqrt(np.mean(np.square(off))) < 1.6 and max(off) < 5.0
    assert fit.unit == ("A" if prefix == "i" else "N·m")
    assert all(e.left < e.held_out < 0.05 * e.measured for e in fit.joints)


@pytest.mark.study
def test_intervals_hold_in_95_of_100_cases():
    """200 motions and loads; coloured noise."""
    held = []
    for seed in range(2000, 2200):
        one = motion(seed)
        fit = calibrate_efforts(one.recording(one.noisy(seed)), force=True)
        held += [
            abs(p.value - one.truth[p.name]) <= p.interval95
            for p in fit.identified
            if p.name in one.truth
        ]
    assert 0.93 <= np.mean(held) <= 0.97


def test_a_jittered_clock_of_a_fast_log_hides_no_motion():
    """Stamps jitter by 0.15 ms at 1 kHz: above the motion their noise is most of the speeds."""
    t = np.arange(20_000) / 1000.0
    q = np.stack([0.8 * np.sin(2 * np.pi * f * t + k) for k, f in enumerate((0.2, 0.4, 0.9))], 1)
    speed = np.gradient(q, 1e-3, axis=0)
    late = 1.5e-4 * np.random.default_rng(4).normal(size=(len(t), 1))
    clean, jittered = cutoff_of(q, 1000.0), cutoff_of(q + speed * late, 1000.0)
    assert clean == pytest.approx(4.5, rel=0.1)
    assert jittered == pytest.approx(clean, rel=0.2)


def test_a_load_does_not_run_away_where_currents_leave_the_scale_open():
    """Readings that follow the load's columns and hardly the nominal robot's: the best fit has an
    endless load and no gain."""
    rng = np.random.default_rng(5)
    rows, joints = 800, 3
    nominal, load, noise = (rng.normal(size=(rows, joints)) for _ in range(3))
    y = 0.1 * (0.02 * nominal + load) + 0.01 * noise
    problem = Problem(
        y, nominal, load[:, :, None], ("tool.mass",), np.ones((rows, joints, 1)), ("drive.offset",),
        np.ones((rows, joints), dtype=bool), np.arange(rows) * FOLDS // rows, True, np.ones(1),
    )  # fmt: skip
    gain, change, _ = parts(problem, solve(problem).x)
    assert (gain > 0.0).all() and change[0] < 20.0


def test_links_are_told_as_base_parameters(either):
    loaded = "link.8." if either.looped else "link.6."  # the wrist has the load
    fit = calibrate_efforts(either.recording(either.noisy(6)), ["link", *FREE, "drive.inertia"])
    assert any(p.name.startswith(loaded) for p in fit.identified)
    assert all(e.explained > 0.95 for e in fit.joints)


@pytest.mark.parametrize(("robot", "count"), [(UR5, 36), (loops.MEDRUE, 43)])
def test_base_parameters_explain_all_torques_and_are_independent(robot, count):
    rng, theta = np.random.default_rng(7), robot.parameters.nominal
    base, at = BaseParameters(robot, theta), robot.sample(50, rng)
    q = Jet(at, rng.normal(size=at.shape), rng.normal(size=at.shape))
    y = torque_regressor(robot, theta, q, np.array(robot.gravity)).reshape(300, -1)
    kept, phi = y[:, base.columns], rng.normal(size=y.shape[1])
    assert np.abs(kept @ base.grouping - y).max() < 1e-8
    singular = np.linalg.svd(kept / np.linalg.norm(kept, axis=0), compute_uv=False)
    assert singular[-1] > 1e-4 and np.linalg.matrix_rank(y, 1e-9 * np.abs(y).max()) == count
    assert len(base.names) == count
    found = np.linalg.lstsq(kept, y @ phi, rcond=None)[0]
    assert np.abs(found - base.grouping @ phi).max() < 1e-8


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        (lambda t, q, y: (t, q[:1].repeat(len(q), axis=0), y), CalibrationError, "needs a motion"),
        (lambda t, q, y: (t[:50], q[:50], y[:50]), CalibrationError, "50 rows"),
        (lambda t, q, y: (t * (1.0 + 0.02 * t), q, y), RecordingError, "make the clock even"),
        (lambda t, q, y: (t, q, y * [1, 1, 1, 1, 0, 1]), CalibrationError, "'tau5' never changes"),
        (lambda t, q, y: (t, q[::-1], y), CalibrationError, "explains nothing on rows"),
        (lambda t, q, y: (t, q[:1] + 1e-3 * np.sin(q), y), CalibrationError, "1 never moves"),
    ],
)
def test_what_cannot_be_fitted_is_named(clean, change, error, words):
    with pytest.raises(error, match=words):
        calibrate_efforts(arm.recording(*change(clean.t, clean.q.v, clean.noisy(9))))


def test_the_pieces_between_gaps_and_segments_are_fitted_together(clean):
    whole, cut = clean.recording(clean.noisy(9)), np.where(clean.t > 7.0, clean.t + 1.0, clean.t)
    gone = (clean.t > 3.0) & (clean.t < 3.5)
    columns = {c: v[~gone] for c, v in (whole.columns | {"t": cut}).items()}
    fit = calibrate_efforts(Recording(whole.metadata, columns, "gaps"))
    for value in calibrate_efforts(whole).identified:
        std = np.hypot(fit[value.name].std, value.std)
        assert abs(fit[value.name].value - value.value) < 3.0 * std


def test_groups_are_checked_and_odd_signs_and_inertias_refused_or_forced(clean):
    with pytest.raises(ParameterError, match=r"drive\.colomb: is none of"):
        calibrate_efforts(clean.recording(), ["drive.colomb"])
    wrong = clean.recording(-clean.noisy(8) / CONSTANT, "i")
    with pytest.raises(CalibrationError, match=r"drive\.constant\.1 .* opposite sign"):
        calibrate_efforts(wrong)
    assert "opposite sign" in calibrate_efforts(wrong, force=True).refuted
    # Motors without the rotors that the model has: five seconds give their inertia to the tool.
    t, q = fourier(np.random.default_rng(3), seconds=5.0)
    bare = arm.recording(t, q.v, torques(q, armature=0.0) + COULOMB * np.sign(q.d), "tau")
    with pytest.raises(CalibrationError, match=r"tool\.inertia\.\w+ .* free drive\.inertia"):
        calibrate_efforts(bare, ("drive.coulomb", "tool"))
    assert calibrate_efforts(bare, ("drive.coulomb", "tool"), force=True).refuted


def test_an_empty_hand_on_links_that_are_a_little_lighter_is_no_refusal(clean):
    nothing = UR5.theta_of_tool(UR5.parameters.nominal.copy(), 1e-3, arm.COG)
    load = torques(clean.q, arm.LOADED) - torques(clean.q, nothing)

    def fit_of(share):
        def lighter(model):
            links = [b for b in range(1, model.nbody) if model.body(b).name not in arm.TOOLS]
            model.body_mass[links] *= 1.0 - share

        links = torques(clean.q, edit=lighter) - torques(clean.q)
        return calibrate_efforts(clean.recording(clean.noisy(6) - load + links))

    fit = fit_of(0.02)
    mass = fit["tool.mass"]
    assert mass.value < 0.0 < mass.value + mass.interval95 < 1.0
    assert "% of each link's mass" in fit.status and fit["tool.cog.z"].std is None
    assert f"known only to be below {mass.value + mass.interval95:.2g} kg" in fit.status
    with pytest.raises(CalibrationError, match=r"tool\.mass comes out as -\d"):
        fit_of(0.2)


@pytest.mark.parametrize("prefix", ["tau", "i"])
@pytest.mark.parametrize("angle", [40.0, 90.0, 180.0])
def test_a_gravity_along_another_axis_is_named(clean, angle, prefix):
    scale, at = CONSTANT if prefix == "i" else 1.0, np.deg2rad(angle)
    stated = (0.6 * 9.8 * np.sin(at), 0.8 * 9.8 * np.sin(at), -9.8 * np.cos(at))
    with pytest.raises(CalibrationError, match=f"axis of the base, {angle:.0f}°") as error:
        calibrate_efforts(clean.recording(clean.noisy(7) / scale, prefix, gravity=stated))
    named = json.loads(re.search(r"state gravity = (\[.*?\])", str(error.value))[1])
    assert named == pytest.approx([0.0, 0.0, -9.8], abs=0.2)


def test_known_constants_make_currents_torques(clean, tmp_path):
    seen = clean.noisy(12)
    currents = clean.recording(seen / CONSTANT, "i")
    known = calibrate_efforts(currents, constants=CONSTANT)
    plain, found = calibrate_efforts(clean.recording(seen)), calibrate_efforts(currents)
    for a, b in zip(known.identified, plain.identified, strict=True):
        assert a.name == b.name and a.value == pytest.approx(b.value, rel=1e-9, abs=1e-12)
    assert known["tool.mass"].std < found["tool.mass"].std
    calibrate_efforts(currents, ("drive",), constants=CONSTANT).write(tmp_path / "fit.json")
    drives = stated_drives(currents, tmp_path / "fit.json")
    assert drives.of("drive.constant") == pytest.approx(CONSTANT)
    for constants, words in ((CONSTANT[:5], "give 6 numbers"), (-CONSTANT, "above 0")):
        with pytest.raises(ParameterError, match=words):
            calibrate_efforts(currents, constants=constants)


def test_the_verb_writes_a_fit_that_no_export_takes_for_one_of_the_wrench(clean, tmp_path, capsys):
    path, out = tmp_path / "rec.parquet", tmp_path / "fit.json"
    clean.recording(clean.noisy(10)).write(path)
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
    names = ["timestamp", *(f"actual_{k}_{j}" for k in ("q", "current") for j in range(6))]
    table = np.column_stack([clean.t, clean.q.v, clean.noisy(11) / CONSTANT])
    csv = tmp_path / "robot.csv"
    np.savetxt(csv, table, delimiter=",", header=",".join(names), comments="", fmt="%.9f")
    out = tmp_path / "rec.parquet"
    assert main(["import", str(csv), "--map", "ur-rtde-current", "--out", str(out)]) == 0
    made = Recording.read(out)
    assert made.effort == "i" and len(made) == len(clean.t)
    assert made.metadata.sensor.noise_std is None  # of a wrench; this has none
    fit = calibrate_efforts(made)
    assert abs(fit["tool.mass"].value - MASS) < fit["tool.mass"].interval95


def test_a_motion_of_torques_without_a_clock_needs_its_rate(clean, tmp_path, capsys):
    names = [f"{kind}_{j}" for kind in ("q", "tau") for j in range(6)]
    csv, found = tmp_path / "robot.csv", tmp_path / "rec.map.toml"
    table = np.column_stack([clean.q.v, clean.noisy(11)])
    np.savetxt(csv, table, delimiter=",", header=",".join(names), comments="", fmt="%.9f")
    line = ["import", str(csv), "--out", str(tmp_path / "rec.parquet")]
    assert main([*line, "--guess", "--robot", "ur5"]) == 1
    remedy = f"of {found} state rate_hz and mode = 'dynamic'"
    assert remedy in capsys.readouterr().err
    rate = f'mode = "dynamic"\nrate_hz = {1.0 / clean.t[1]}'
    found.write_text(found.read_text().replace('mode = "static"', rate))
    assert main([*line, "--map", str(found)]) == 0
    fit = calibrate_efforts(Recording.read(tmp_path / "rec.parquet"))
    assert abs(fit["tool.mass"].value - MASS) < fit["tool.mass"].interval95


def test_what_is_divided_by_a_number_that_may_be_zero_is_not_told():
    """No load turns about the last axis: its currents show friction and no constant."""
    t, q = fourier(np.random.default_rng(13))
    theta = UR5.theta_of_tool(UR5.parameters.nominal.copy(), 1e-4, (0.0, 0.0, 0.01))
    body = torques(q, theta, armature=0.1 * np.array([1, 1, 1, 1, 1, 0]))
    bare = Motion(t, q, body + COULOMB * np.sign(q.d) + VISCOUS * q.d, {})
    tool = {"mass": 1e-4, "cog": [0.0, 0.0, 0.01], "inertia": [1e-6, 1e-6, 1e-6, 0, 0, 0]}
    fit = calibrate_efforts(bare.recording(bare.noisy(13) / CONSTANT, "i", tool=tool))
    assert fit["drive.constant.6"].std is None and fit["drive.coulomb.6"].std is None
    assert fit["tool.cog.x"].std is None and fit["tool.mass"].std is not None
    assert fit["drive.constant.2"].std is not None
    assert "does not tell drive.constant.6" in fit.status and " link" in fit.status
