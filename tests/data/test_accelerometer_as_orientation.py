"""A wrench and an accelerometer, and nothing else that says how the sensor is turned."""

import json
from itertools import pairwise

import numpy as np
import pytest

import wrenchbed as wb
from plain_ur5 import COG, GRAVITY, MASS, NOISE, flange, poses
from wrenchbed.cli import main
from wrenchbed.physics.wrench import CHANNELS

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
