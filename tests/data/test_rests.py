"""Continuous logs are split into holds and moves; an accelerometer at rest is an orientation."""

import json
import re
from contextlib import suppress
from itertools import pairwise

import numpy as np
import pytest

import plain_ur5
import wrenchbed as wb
from continuous_log import TRUTH, How, log, random_how
from plain_ur5 import COG, GRAVITY, MASS, NOISE, flange, poses
from wrenchbed.cli import main
from wrenchbed.data.holds import check_at_rest, gather, noise_at_rest, split
from wrenchbed.data.metadata import Metadata
from wrenchbed.data.recording import Recording
from wrenchbed.errors import CalibrationError, RecordingError
from wrenchbed.physics.wrench import CHANNELS


def calibrated(recording) -> np.ndarray:
    """Errors of mass, CoG and bias in their own standard uncertainties."""
    fit = wb.calibrate(recording)
    return np.array([(v.value - TRUTH[v.name]) / v.std for v in fit.identified if v.name in TRUTH])


def judged(seed: int) -> tuple[bool, np.ndarray]:
    """Whether the holds of a random log are right, and the errors of its calibration."""
    recording, hold = log(random_how(seed), seed)
    found = split(recording)
    rest = found.at_rest(recording, Metadata(recording.metadata.robot, "static"))
    right = len(found.seconds) == len(hold) and found.moves == len(hold) - 1
    return right, calibrated(rest)


@pytest.mark.sampled
@pytest.mark.parametrize("seed", range(2))
def test_holds_are_found_and_calibrate(seed):
    right, errors = judged(seed)
    assert right and np.abs(errors).max() < 4.0


def test_a_tool_that_rings_when_a_hold_begins_is_said_to_and_the_remedy_works():
    recording, _ = log(random_how(5064), 5064)
    rest = split(recording).at_rest(recording, Metadata(recording.metadata.robot, "static"))
    with pytest.raises(CalibrationError, match="the tool still rings. Leave out the first") as why:
        calibrated(rest)
    first = int(re.search(r"the first (\d+) rows of each", str(why.value))[1])
    place = np.concatenate([np.arange(n) for n in gather(rest, np.ones(len(rest), bool)).count])
    columns = {name: x[place >= first] for name, x in rest.columns.items()}
    assert np.abs(calibrated(Recording(rest.metadata, columns, rest.name))).max() < 4.0


@pytest.mark.study
def test_many_logs_are_split_and_calibrate():
    """One of a hundred may be refused: its tool rings (above)."""
    found = []
    for seed in range(5000, 5300):
        with suppress(CalibrationError):
            found.append(judged(seed))
    assert len(found) >= 0.99 * 300
    assert np.mean([right for right, _ in found]) >= 0.99
    errors = np.concatenate([e for _, e in found])
    assert np.mean(np.abs(errors) < 3.0) >= 0.99


def save(folder, recording):
    names = list(recording.columns)
    rows = np.stack([recording.columns[n] for n in names], axis=1)
    np.savetxt(folder / "log.csv", rows, delimiter=",", header=",".join(names), comments="")
    columns = {c: {"column": c, "unit": "N" if c[0] == "f" else "N·m"} for c in CHANNELS}
    columns |= {q: {"column": q, "unit": "rad"} for q in recording.joints}
    columns |= {"t": {"column": "t", "unit": "s"}}
    raw = {"recording": {"robot": "ur5", "mode": "auto"}, "file": [{"columns": columns}]}
    (folder / "map.json").write_text(json.dumps(raw))
    return [str(folder / "log.csv"), "--map", str(folder / "map.json")]


def test_a_log_is_imported_as_poses_and_its_moves_are_kept(tmp_path, capsys):
    recording, hold = log(How(holds=9, lost=0.01), 7)
    out = tmp_path / "rec.parquet"
    assert main(["import", *save(tmp_path, recording), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    low, high = map(float, re.search(r"9 holds of (.*) … (.*) s; 8 moves", said).groups())
    assert hold.min() < low < hold.min() + 0.5 and hold.max() < high < hold.max() + 0.5
    rest = wb.Recording.read(out)
    assert rest.metadata.mode == "static"
    assert len(gather(rest, np.ones(len(rest), dtype=bool))) == 9
    assert np.abs(calibrated(rest)).max() < 4.0
    motion = wb.Recording.read(tmp_path / "rec.motion.parquet")
    assert motion.metadata.mode == "dynamic" and set(motion.columns["hold"]) == set(range(-1, 9))
    assert np.ptp(motion.q, axis=0).min() > 0.1
    of_recording = 0.8 * np.array([0.05, 0.05, 0.1, 2e-3, 2e-3, 2e-3])
    assert np.allclose(motion.metadata.sensor.noise_std, of_recording, rtol=0.25)


def test_many_poses_are_poses_and_a_motion_without_a_hold_is_none():
    rng = np.random.default_rng(4)
    check_at_rest(of_joints(rng.uniform(-1, 1, (500, 6))), "a map without a clock")
    check_at_rest(of_joints(np.repeat(rng.uniform(-1, 1, (50, 6)), 10, axis=0)))
    t = np.arange(2000) / 100.0
    with pytest.raises(RecordingError, match=r"nothing rests for 0.4 s; .* mode = 'dynamic'"):
        split(of_joints(np.stack([np.sin(0.5 * t + j) for j in range(6)], axis=1)))


def of_joints(q, rate=100.0):
    t = np.arange(len(q)) / rate
    columns = {"t": t} | {f"q{j + 1}": q[:, j] for j in range(q.shape[1])}
    rng = np.random.default_rng(0)
    columns |= {c: rng.normal(size=len(q)) for c in CHANNELS}
    return Recording(Metadata("ur5", "dynamic"), columns)


@pytest.mark.parametrize("back", [False, True], ids=["one way", "there and back"])
def test_slow_turning_of_one_joint_is_as_good_as_rest_where_nothing_rests(tmp_path, back, capsys):
    """A UR5 of plain numpy that turns joint 5 within a minute; it comes to rest at most once."""
    rng, t = np.random.default_rng(3), np.arange(6000) / 100.0
    q = np.tile([0.3, -1.2, 1.4, -0.8, 0.6, 0.2], (len(t), 1))
    q[:, 4] = 0.6 + 1.5 * np.sin(np.pi * t / 60.0) if back else -1.2 + 0.05 * t
    turn = np.array([plain_ur5.flange(x)[:3, :3] for x in q])
    force = plain_ur5.MASS * plain_ur5.GRAVITY @ turn
    load = np.hstack([force, np.cross(plain_ur5.COG, force)])
    load += plain_ur5.NOISE * rng.normal(size=load.shape)
    columns = {"t": t} | {f"q{j + 1}": q[:, j] for j in range(6)}
    columns |= dict(zip(CHANNELS, load.T, strict=True))
    out = tmp_path / "rec.parquet"
    recording = Recording(Metadata("ur5", "dynamic"), columns)
    assert main(["import", *save(tmp_path, recording), "--out", str(out)]) == 0
    assert "rows turn slowly enough to show gravity alone" in capsys.readouterr().out
    fit = {v.name: v for v in wb.calibrate(wb.Recording.read(out)).identified}
    assert fit["tool.mass"].value == pytest.approx(plain_ur5.MASS, abs=5.0 * fit["tool.mass"].std)
    assert fit["tool.mass"].std < 1e-3


def test_creep_is_no_hold_flicker_splits_none_and_rests_tell_the_noise():
    t = np.arange(6000) / 100.0
    q = np.zeros((len(t), 6))
    q[:, 2] = np.where(t < 30.0, 0.002 * t, 0.06)  # 2 mrad/s, then rest
    found = split(of_joints(q))
    assert len(found.seconds) == 1 and found.hold[:2900].max() == -1
    q = np.zeros((1000, 6))
    q[400:402, 3] = 5e-4
    found = split(of_joints(q))
    assert len(found.seconds) == 1 and found.moves == 0
    assert found.sentence == "1 hold of 10 s; 0 moves"
    recording, _ = log(How(holds=5), 3)
    std = noise_at_rest(recording)
    assert np.allclose(std, [0.05, 0.05, 0.1, 2e-3, 2e-3, 2e-3], rtol=0.1)


def test_a_noisy_encoder_does_not_make_a_pose_of_every_row():
    rng = np.random.default_rng(1)
    q = np.repeat(rng.uniform(-1, 1, (5, 6)), 200, axis=0)
    noisy = of_joints(q + 4e-4 * rng.standard_normal(q.shape))
    segment = np.repeat(np.arange(5), 200)
    columns = dict(noisy.columns) | {"segment": segment}
    still = Recording(Metadata("ur5", "static"), columns)
    assert len(gather(still, np.ones(1000, dtype=bool))) == 5
    clean = dict(of_joints(q).columns) | {"segment": np.zeros(1000, dtype=int)}
    poses = Recording(Metadata("ur5", "static"), clean)  # told apart without segment, too
    assert len(gather(poses, np.ones(1000, dtype=bool))) == 5


BIAS = np.array([2.0, -3.0, 5.0, 0.05, -0.08, 0.03])
ZERO = np.array([0.12, -0.09, 0.15])
"""Error of an accelerometer's zero [m/s²]: 10 to 15 mg, as MEMS sensors have."""


def written(path, q, hold, rate=100.0, spoil=1.0):
    """A log of joint values (N, 6) that holds the wrench and the accelerometer alone."""
    rng = np.random.default_rng(5)
    turn = np.array([flange(x)[:3, :3] for x in q])
    down = GRAVITY @ turn
    wrench = np.hstack([MASS * down, np.cross(COG, MASS * down)]) + BIAS
    read = -spoil * down * [1.002, 0.998, 1.001] + ZERO + 0.03 * rng.normal(size=down.shape)
    wrench += NOISE * rng.normal(size=wrench.shape)
    t = np.arange(len(q)) / rate + 2.0 * hold
    header = ",".join(("t", "ax", "ay", "az", *CHANNELS))
    rows = np.column_stack([t, read, wrench])
    np.savetxt(path, rows, delimiter=",", header=header, comments="")
    return path


def at_rest(folder, count=40, **how):
    q, hold = poses(count, np.random.default_rng(2)), np.repeat(np.arange(count), 15)
    return written(folder / "log.csv", q[hold], hold, **how)


def right(file):
    fit = {v.name: v for v in wb.calibrate(wb.Recording.read(file)).identified}
    assert fit["tool.mass"].value == pytest.approx(MASS, rel=0.005)
    cog = [fit[f"tool.cog.{a}"].value for a in "xyz"]
    assert cog == pytest.approx(COG, abs=1e-3)
    bias = np.array([fit[f"sensor.bias.{c}"].value for c in CHANNELS])
    assert (np.abs(bias - BIAS) < [0.1, 0.1, 0.1, 0.01, 0.01, 0.01]).all()


def test_poses_at_rest_calibrate_by_the_accelerometer_and_its_zero_does_not_matter(
    tmp_path, capsys
):
    file, out = at_rest(tmp_path), tmp_path / "rec.parquet"
    assert main(["import", str(file), "--guess", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "40 poses at rest, its zero off by 0.2" in said
    assert "the turn about the vertical is not known" in said
    right(out)
    again = tmp_path / "again.parquet"
    line = ["import", str(file), "--map", str(tmp_path / "rec.map.toml"), "--out", str(again)]
    assert main(line) == 0
    assert np.array_equal(wb.Recording.read(again).q, wb.Recording.read(out).q)
    assert "ax" not in wb.Recording.read(out).columns  # it is no second witness


def test_a_log_of_holds_and_moves_needs_mode_auto(tmp_path, capsys):
    knots, rate = poses(20, np.random.default_rng(4)), 50.0
    s = np.linspace(0.0, 1.0, int(1.5 * rate))[:, None] ** 2
    s = s * (3.0 - 2.0 * np.sqrt(s))
    q = [np.vstack([np.tile(a, (60, 1)), a + s * (b - a)]) for a, b in pairwise(knots)]
    file = written(tmp_path / "log.csv", np.concatenate(q), 0.0, rate)
    out = tmp_path / "rec.parquet"
    assert main(["import", str(file), "--guess", "--out", str(out), "--mode", "static"]) == 1
    assert "--mode auto finds the rows at rest" in capsys.readouterr().err
    assert main(["import", str(file), "--guess", "--out", str(out), "--mode", "auto"]) == 0
    right(out)


def test_what_does_not_read_gravity_is_refused(tmp_path, capsys):
    file, out = at_rest(tmp_path, spoil=0.5), tmp_path / "rec.parquet"
    units = {"a": "m/s²", "f": "N", "t": "N·m"}
    columns = {c: {"column": c, "unit": units[c[0]]} for c in ("ax", "ay", "az", *CHANNELS)}
    raw = {"recording": {"robot": "any", "mode": "static"}, "file": [{"columns": columns}]}
    (tmp_path / "map.json").write_text(json.dumps(raw))
    line = ["import", str(file), "--map", str(tmp_path / "map.json"), "--out", str(out)]
    assert main(line) == 1
    assert "an accelerometer gives one only at rest" in capsys.readouterr().err
