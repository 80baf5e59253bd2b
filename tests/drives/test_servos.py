"""Fits of position servos: truths of two simulators recovered, replays of motions nobody fitted."""

import json

import mujoco
import numpy as np
import pytest
from pytest import approx

import wrenchbed as wb
from servo_arm import COUNT, Servos, follow, own_servo, recording, teleoperated
from wrenchbed.calibration.fit import IdentifiedValue
from wrenchbed.cli import main
from wrenchbed.drives.effort_fit import impossible
from wrenchbed.errors import CalibrationError, ParameterError

SECONDS = 20.0
SERVOS = Servos()
LOAD = {"tool.mass": 0.05, "tool.cog.x": 0.03, "tool.cog.y": 0.0, "tool.cog.z": 0.004}


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    folder = tmp_path_factory.mktemp("arm")
    (folder / "so.xml").write_text(SERVOS.xml(), encoding="utf-8")
    wb.describe_robot(folder / "so.xml", "tip", folder / "so.toml")
    return wb.load("robots", str(folder / "so.toml")).name


@pytest.fixture(scope="module")
def moved(arm):
    targets = teleoperated(0, SECONDS)
    q = follow(SERVOS, targets, step=5e-4)
    return recording(q, targets, robot=arm), targets, q


@pytest.fixture(scope="module")
def fit(moved):
    return wb.calibrate_servos(moved[0])


def replayed(path, targets, rate=50.0):
    """Joint values (N, 6) of a written model whose controls are held from row to row."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data, rows = mujoco.MjData(model), np.empty_like(targets)
    data.qpos[:] = targets[0]
    for k, target in enumerate(targets):
        rows[k] = data.qpos
        data.ctrl[:] = target
        mujoco.mj_step(model, data, round(1.0 / rate / model.opt.timestep))
    return rows


def rms(error):
    """Of each joint (6,), the first second left out."""
    return np.sqrt(np.mean(error[50:] ** 2, axis=0))


def off(fit, truth, slack):
    """Errors in standard uncertainties, of values beyond a slack by kind."""
    far = {}
    for name, true in truth.items():
        p = fit[name]
        error = max(abs(p.value - true) - slack.get(name.rpartition(".")[0], 0.0), 0.0)
        far[name] = error / p.std
    return far


def test_the_servos_of_mujoco_come_out_within_their_intervals(fit):
    far = np.array(list(off(fit, SERVOS.truth() | LOAD, {"servo.delay": 5e-4}).values()))
    assert far.max() < 4.0 and np.sqrt(np.mean(far**2)) < 1.5
    assert fit["servo.stiffness.2"].std < 0.01 * fit["servo.stiffness.2"].value
    assert all(e.explained > 0.97 for e in fit.joints) and fit.cannot_tell == ()


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 4))]
)
def test_another_servo_law_moves_no_value_beyond_its_interval(arm, seed):
    """Friction rises by up to 0.3 towards rest there, and setpoints have a largest speed."""
    targets = teleoperated(seed, SECONDS)
    fit = wb.calibrate_servos(recording(own_servo(SERVOS, targets), targets, robot=arm))
    slack = {"servo.delay": 1.5e-3, "drive.coulomb": 0.3 * 0.06}
    far = np.array(list(off(fit, SERVOS.truth() | LOAD, slack).values()))
    assert far.max() < 4.0 and np.sqrt(np.mean(far**2)) < 1.5


@pytest.mark.parametrize("law", [follow, pytest.param(own_servo, marks=pytest.mark.slow)])
def test_written_servos_trail_a_motion_that_nobody_fitted_as_the_robot_does(
    fit, arm, law, tmp_path
):
    if law is own_servo:
        targets = teleoperated(0, SECONDS)
        fit = wb.calibrate_servos(recording(law(SERVOS, targets), targets, robot=arm))
    fit.write(tmp_path / "fit.json")
    mjcf, readme = wb.export_servos(tmp_path / "fit.json", tmp_path / "model")
    targets = teleoperated(9, 8.0)
    q = law(SERVOS, targets)
    before, after = rms(q - targets), rms(q - replayed(mjcf, targets))
    oracle = rms(q - follow(SERVOS, targets))
    assert (before - after > 0.95 * (before - oracle)).all()
    model = mujoco.MjModel.from_xml_path(str(mjcf))
    assert model.actuator_delay == approx(model.numeric("servo_delay").data)
    assert model.dof_frictionloss == approx(SERVOS.friction, rel=0.2)
    assert "| q1 |" in readme.read_text(encoding="utf-8")


def test_counting_encoders_move_nothing(arm, moved):
    """Noise of encoders twice as coarse would lower inertia and damping by many σ."""
    _, targets, q = moved
    coarse = 2.0 * COUNT
    fit = wb.calibrate_servos(
        recording(np.round(q / coarse) * coarse, targets, robot=arm, counts=False)
    )
    far = off(fit, SERVOS.truth(), {"servo.delay": 5e-4})
    assert max(v for k, v in far.items() if k.startswith(("drive.inertia", "drive.viscous"))) < 4.0


def test_episodes_and_gaps_part_the_pieces_and_short_ones_are_left_out(arm, moved, fit):
    _, targets, q = moved
    apart = np.r_[0:490, 495:550, 560:1000]  # the middle is shorter than the filter
    whole = recording(q, targets, robot=arm)
    columns = {k: v[apart] for k, v in whole.columns.items()}
    gaps = wb.calibrate_servos(wb.Recording(whole.metadata, columns, "gaps"))
    assert gaps.rows == 930
    columns |= {"t": np.arange(len(apart)) / 50.0, "segment": np.repeat([0, 1, 2], [490, 55, 440])}
    episodes = wb.calibrate_servos(wb.Recording(whole.metadata, columns, "episodes"))
    for p in gaps.identified:
        assert episodes[p.name].value == approx(p.value, abs=p.std), p.name
        assert fit[p.name].value == approx(p.value, abs=5.0 * p.std + 1e-4), p.name


def test_what_cannot_be_fitted_is_refused_with_its_reason(arm, moved):
    log, targets, q = moved
    for changed, why in (
        (recording(targets, targets, robot=arm, counts=False), "echo"),
        (recording(q[:90], targets[:90], robot=arm), "100 rows"),
        (recording(q, targets, robot=arm, mode="static"), "at rest"),
        (recording(q, targets[::-1], robot=arm), "explains nothing"),
        (recording(q, 2.0 * q - targets, robot=arm), "negative"),
    ):  # fmt: skip
        with pytest.raises(CalibrationError, match=why):
            wb.calibrate_servos(changed)
    seen = dict.fromkeys(("mx", "my", "mz"), q[:, 0])
    some = {k: v for k, v in log.columns.items() if k != "q_target3"}
    with pytest.raises(CalibrationError, match="q_target3"):
        wb.calibrate_servos(wb.Recording(log.metadata, some | seen, "x"))
    with pytest.raises(ParameterError, match="servo and tool"):
        wb.calibrate_servos(log, ["link"])
    below = [IdentifiedValue("servo.stiffness.1", -3.0, 1.0, "N·m/rad", 0.0, 2.0)]
    assert impossible(below).endswith("state the tool and --free servo")
    assert impossible([IdentifiedValue("tool.inertia.xx", -3e-4, 1e-4, "kg·m²", 0.0, 2e-4)]) is None


def test_a_load_that_is_stated_is_held(moved, fit):
    held = wb.calibrate_servos(moved[0], ["servo"])
    assert not [p for p in held.identified if p.name.startswith("tool")]
    assert held["servo.stiffness.2"].std < fit["servo.stiffness.2"].std


def test_the_command_line_fits_writes_and_says_what_it_cannot_do(moved, tmp_path, capsys):
    rec, out, model = tmp_path / "rec.parquet", tmp_path / "fit.json", tmp_path / "model"
    moved[0].write(rec)
    assert main(["calibrate", str(rec), "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    assert "joint tracking errors" in shown and "servo.stiffness.1" in shown
    assert all(len(line) <= 80 for line in shown.splitlines() if str(tmp_path) not in line)
    written = json.loads(out.read_text(encoding="utf-8"))
    assert written["channels"] == "command"
    assert written["parameters"]["servo.delay.1"]["unit"] == "s"
    assert main(["export", str(out), "--to", "mjcf", "--out", str(model)]) == 0
    assert [p.suffix for p in sorted(model.iterdir())] == [".md", ".xml"]
    capsys.readouterr()
    assert main(["export", str(out), "--to", "ur", "--out", str(tmp_path / "ur.txt")]) == 1
    assert "fit of commands" in capsys.readouterr().err
