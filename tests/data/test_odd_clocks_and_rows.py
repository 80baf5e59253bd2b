"""Logs and text tables as programs write them: stamps, lines of units, holes, separators."""

import json
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

import wrenchbed as wb
from plain_ur5 import PlainUr5
from wrenchbed.cli import main
from wrenchbed.data import text_table
from wrenchbed.data.clock import evened
from wrenchbed.data.column_map import read
from wrenchbed.data.import_files import import_files
from wrenchbed.data.recording import Recording
from wrenchbed.data.text_table import read_text
from wrenchbed.errors import MapError

NAMES = ("q1", "q2", "q3", "q4", "q5", "q6", "fx", "fy", "fz", "tx", "ty", "tz")
TXYZ = NAMES[9:]
MIDNIGHT = datetime(2025, 3, 1, 23, 59, 30)


@pytest.fixture(scope="module")
def log():
    recording = PlainUr5().recording(0, count=20)
    return recording.t, np.stack([recording.columns[n] for n in NAMES], axis=1)


def write(path, header, clock, values, spoil=lambda cells, row: cells):
    lines = list(header)
    for row, (stamp, of_row) in enumerate(zip(clock, values.tolist(), strict=True)):
        lines.append(",".join([stamp, *spoil([repr(x) for x in of_row], row)]))
    path.write_text("\n".join(lines) + "\n")
    return path


def mapped(folder, mode, files):
    """Path of a map of files, by name, with the columns ``t`` and some of `NAMES`."""
    unit, raw = {"t": "s", "q": "rad", "f": "N"}, {"recording": {"robot": "ur5", "mode": mode}}
    columns = {n: {"column": n, "unit": "N·m" if n in TXYZ else unit[n[0]]} for n in ("t", *NAMES)}
    parts = ((file, {n: columns[n] for n in ("t", *names)}) for file, names in files.items())
    raw |= {"file": [{"match": file, "columns": part} for file, part in parts]}
    (folder / "map.json").write_text(json.dumps(raw))
    return folder / "map.json"


def came(path, t, values, *options):
    """The guessed recording, and again by its map; both are what was written."""
    out = path.with_suffix(".parquet")
    line = ["import", str(path), "--guess", "--robot", "ur5", "--out", str(out), *options]
    assert main(line) == 0
    again = path.with_suffix(".again.parquet")
    line = ["import", str(path), "--map", str(path.with_suffix(".map.toml")), "--out", str(again)]
    assert main(line) == 0
    for file in (out, again):
        recording = Recording.read(file)
        assert recording.t == pytest.approx(t - t[0], abs=2e-6)
        assert np.allclose([recording.columns[n] for n in NAMES], values.T)
    return recording


def seconds_and_parts(moment):
    return str(1740872370 + moment // 10**9), str(moment % 10**9)


@pytest.mark.parametrize(
    ("names", "stamp"),
    [
        ("t", lambda s: (MIDNIGHT + timedelta(seconds=s)).isoformat() + "Z"),
        *(
            ("stamp", lambda s, form=form: f"{MIDNIGHT + timedelta(seconds=s):{form}}")
            for form in (
                "%Y/%m/%d %H:%M:%S.%f",
                "%H:%M:%S:%f",
                "%d.%m.%Y %H:%M:%S.%f",
                "%m/%d/%Y %I:%M:%S.%f %p",
                "%d-%b-%Y %H:%M:%S.%f",
            )
        ),
        ("secs,nsecs", lambda s: ",".join(seconds_and_parts(round(s * 1e9)))),
        ("stamp.sec,stamp.nanosec", lambda s: ",".join(seconds_and_parts(round(s * 1e9)))),
        (
            "runtime_state,timestamp_us",
            lambda s: f"7,{(2**32 - 5_000_000 + round(s * 1e6)) % 2**32}",
        ),
    ],
)
def test_a_clock_of_text_or_of_two_columns_is_a_clock(tmp_path, log, names, stamp):
    t, values = log
    header = [",".join((names, *NAMES))]
    came(write(tmp_path / "log.csv", header, map(stamp, t.tolist()), values), t, values)


def test_a_line_of_units_is_none_of_names(tmp_path, log):
    t, values = log
    values = values * np.repeat([np.rad2deg(1.0), 1.0, 1e3], [6, 3, 3])
    units = ",".join(["s", *["deg"] * 6, *["N"] * 3, *["Nmm"] * 3])
    lines = [",".join(("t", *NAMES)), units]
    path = write(tmp_path / "log.csv", lines, map(repr, t.tolist()), values)
    came(path, t, log[1])


def test_rows_without_a_value_are_left_out_where_that_is_asked_for(tmp_path, log, capsys):
    t, values = log
    path = write(
        tmp_path / "log.csv", [",".join(("t", *NAMES))], map(repr, t.tolist()), values,
        lambda cells, row: [*cells[:8], {7: "", 50: "-"}.get(row, cells[8]), *cells[9:]],
    )  # fmt: skip
    path.write_text(path.read_text()[:-30])  # stopped within the last row
    out = str(tmp_path / "rec.parquet")
    assert main(["import", str(path), "--guess", "--robot", "ur5", "--out", out]) == 1
    assert "--skip-incomplete leaves such rows out" in capsys.readouterr().err
    keep = np.delete(np.arange(len(t)), [7, 50, len(t) - 1])
    came(path, t[keep], values[keep], "--skip-incomplete")
    assert "3 rows without a value left out" in capsys.readouterr().out


@pytest.mark.parametrize("beside", [0, 3])
def test_topics_with_rows_of_their_own_in_one_table_are_put_together_by_the_clock(
    tmp_path, log, beside
):
    """As PlotJuggler exports them: a row for each stamp, no value in the other topic's columns;
    or one clock for both, with joints in one of four rows."""
    t, values = log
    names = [f"/joint_states/{k}/position" for k in wb.load("robots", "ur5").joint_names]
    names += [f"/ft/wrench/{kind}/{axis}" for kind in ("force", "torque") for axis in "xyz"]
    lines = [",".join(["__time", *names])]
    for stamp, row in zip(t.tolist(), values.tolist(), strict=True):
        cells = [repr(x) for x in row]
        first = cells[6:] if beside else [""] * 6
        lines.append(",".join([f"{1.7e9 + stamp:.6f}", *cells[:6], *first]))
        for k in range(1, beside or 2):
            lines.append(",".join([f"{1.7e9 + stamp + 0.004 * k:.6f}", *[""] * 6, *cells[6:]]))
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n")
    out = tmp_path / "rec.parquet"
    line = ["import", str(tmp_path / "log.csv"), "--skip-incomplete", "--out", str(out)]
    assert main([*line, "--guess", "--robot", "ur5", "--mode", "static"]) == 0
    recording = Recording.read(out)
    each = np.repeat(values, beside or 1, axis=0)[: 1 - beside if beside else -1]
    assert np.array_equal(recording.wrench, each[:, 6:])  # the last ones come after all joints
    assert np.abs(recording.q - each[:, :6]).max() < 0.02  # some ms into a pause of 3 s
    assert main([*line[:-1], str(out), "--force", "--map", str(tmp_path / "rec.map.toml")]) == 0


@pytest.mark.parametrize(
    "stems",
    [
        ("q_{}", "tau_{}"), ("angle_{}", "torque_{}"), ("q[{}]", "tau_J[{}]"),
        ("pos_ur5_joint{}", "eff_ur5_joint{}"),
        ("measured_joint_pos_A{}", "measured_torque_A{}", "external_torque_A{}"),
        ("actual_q_{}", "actual_torque_{}", "target_moment_{}"),
        ("/joint_states/{1}/position", "/joint_states/{1}/effort"), ("{1}", "effort_{1}"),
    ],
    ids=str,
)  # fmt: skip
def test_torques_of_joints_are_never_a_wrench(tmp_path, log, capsys, stems):
    _, values = log
    joints = wb.load("robots", "ur5").joint_names
    names = [stem.format(k, joints[k]) for stem in (*stems[2:], *stems[:2]) for k in range(6)]
    other = 6 * (len(stems) - 2)  # those that nobody measured stand first
    rows = [",".join(map(repr, row[:other] + row)) for row in values.tolist()]
    (tmp_path / "log.csv").write_text("\n".join([",".join(names), *rows]) + "\n")
    line = ["import", str(tmp_path / "log.csv"), "--guess", "--out", str(tmp_path / "rec.parquet")]
    assert main(line) == 1
    if names[0].endswith("0"):
        assert "joint torques, and no wrench: --robot NAME" in capsys.readouterr().err
    assert main([*line, "--robot", "ur5"]) == 0
    out, recording = capsys.readouterr().out, Recording.read(tmp_path / "rec.parquet")
    assert "no name states a unit" in out and "no clock: each row is a pose at rest" in out
    assert not recording.has_wrench and np.allclose(recording.columns["tau6"], values[:, 11])


@pytest.mark.parametrize("second", ["right_wrench_{}", "right_{}"])
def test_what_was_taken_for_granted_and_what_is_not_used_is_said(tmp_path, log, capsys, second):
    t, values = log
    others = np.hstack([values, values[:, 6:] + 1.0])
    ends = range(6) if "wrench" in second else ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
    left = [f"left_{n}" for n in NAMES[6:]]
    header = ",".join(("t", *NAMES[:6], *left, *(second.format(end) for end in ends)))
    path = write(tmp_path / "log.csv", [header], map(repr, t.tolist()), others)
    assert main(["import", str(path), "--guess", "--out", str(tmp_path / "rec.parquet")]) == 0
    out = capsys.readouterr().out
    assert "no --robot is stated: ur5's joints explain it" in out
    named = [second.format(end) for end in ends]
    assert f"not used: another wrench, {named[0]} … {named[-1]}" in out


def test_a_file_of_other_things_is_not_used_and_that_is_said(tmp_path, log, capsys):
    t, values = log
    path = write(tmp_path / "a.csv", [",".join(("t", *NAMES))], map(repr, t.tolist()), values)
    other = write(tmp_path / "b.csv", ["t,humidity"], map(repr, t.tolist()), values[:, :1])
    line = ["import", str(path), str(other), "--guess", "--robot", "ur5"]
    assert main([*line, "--out", str(tmp_path / "rec.parquet")]) == 0
    assert f"not used: {other}" in capsys.readouterr().out


def motion(gap_s):
    """Two joints at 500 Hz that turn by sines of up to 1 Hz, without the rows of a gap."""
    t = np.arange(6000) / 500.0
    path = {"q1": np.sin(4.0 * t), "q2": 0.3 * np.sin(6.0 * t + 1.0)}
    keep = (t < 5.0) | (t >= 5.0 + gap_s)
    return t, path, {"t": t[keep]} | {name: q[keep] for name, q in path.items()}


def test_short_gaps_are_filled_along_the_joints_path_where_it_is_known():
    t, path, data = motion(0.026)
    (even, sentence) = evened(data)
    assert "13 dropped frames interpolated" in sentence[0]
    assert even["t"] == pytest.approx(t, abs=1e-9)
    for name, q in path.items():
        assert np.abs(even[name] - q).max() < 1e-6
        second = np.diff(even[name], 2) * 500.0**2
        assert np.abs(second - np.diff(q, 2) * 500.0**2).max() < 0.2  # a line would leave 4 rad/s²
    rng = np.random.default_rng(3)
    _, _, data = motion(0.018)
    noisy = {name: q + 6e-4 * rng.normal(size=len(q)) for name, q in data.items() if name != "t"}
    (even, sentence) = evened({"t": data["t"]} | noisy)
    assert "9 dropped frames interpolated" in sentence[0]
    assert len(even["t"]) == 6000
    t, _, data = motion(0.5)
    (even, sentence) = evened(data)
    assert "1 gaps of 0.502 s in all kept" in sentence[0]
    assert len(even["t"]) == len(t) - 250
    assert np.abs(even["q1"] - np.sin(4.0 * even["t"])).max() < 1e-6


def test_a_joint_that_passes_half_a_turn_is_unwrapped(tmp_path, capsys):
    t = np.arange(1500) / 125.0
    q = np.stack([3.0 + 0.5 * np.sin(1.3 * t + k) for k in range(6)], axis=1)
    values = np.hstack([(q + np.pi) % (2 * np.pi) - np.pi, np.ones((len(t), 6)) + q])
    path = write(tmp_path / "log.csv", [",".join(("t", *NAMES))], map(repr, t.tolist()), values)
    by, out = mapped(tmp_path, "dynamic", {"log.csv": NAMES}), tmp_path / "rec.parquet"
    assert main(["import", str(path), "--map", str(by), "--out", str(out)]) == 0
    assert "q1 passes ±180°: unwrapped" in capsys.readouterr().out
    assert np.ptp(Recording.read(out).q, axis=0).max() < 1.1


def test_joints_of_another_clock_are_unwrapped_before_they_are_laid_beside_a_wrench(tmp_path):
    """A motion of 100 Hz with a gap of 1 s beside a wrench of 250 Hz, whose rows there are left."""
    moving, sensed = np.arange(2000) / 100.0, np.arange(5000) / 250.0
    moving = moving[(moving < 9.0) | (moving > 10.0)]
    path = lambda t: np.stack([3.0 + 0.5 * np.sin(1.3 * t + k) for k in range(6)], axis=1)  # noqa: E731
    wrapped = (path(moving) + np.pi) % (2 * np.pi) - np.pi
    load = np.random.default_rng(0).normal(size=(5000, 6))
    files = ((NAMES[6:], sensed, load, "wrench.csv"), (NAMES[:6], moving, wrapped, "joints.csv"))
    for names, clock, values, name in files:
        write(tmp_path / name, [",".join(("t", *names))], map(repr, clock.tolist()), values)
    by = mapped(tmp_path, "dynamic", {name: names for names, _, _, name in files})
    found = import_files([tmp_path / f[3] for f in files], read(by))
    q, t = found.recording.q, found.recording.t
    turns = 2 * np.pi * np.round((q - path(t)) / (2 * np.pi))
    assert (turns == turns[0]).all() and np.abs(q - turns - path(t)).max() < 1e-4
    assert 240 < found.left_out < 270


def test_poses_far_apart_with_a_pause_between_are_no_turns(tmp_path, capsys):
    """A log of rests alone: the moves between them, of up to 5 rad, are not in it."""
    rng, t, rows = np.random.default_rng(0), [], []
    for pose in range(12):
        t += (3.0 * pose + np.arange(100) / 100.0).tolist()
        rows += [[(-1) ** pose * 2.4 * (1 - k / 10) for k in range(6)]] * 100
    q = np.array(rows) + 3e-4 * rng.normal(size=(1200, 6))
    values = np.hstack([q, np.ones((1200, 6)) + q])
    path = write(tmp_path / "log.csv", [",".join(("t", *NAMES))], map(repr, t), values)
    by, out = mapped(tmp_path, "auto", {"log.csv": NAMES}), tmp_path / "rec.parquet"
    assert main(["import", str(path), "--map", str(by), "--out", str(out)]) == 0
    assert "unwrapped" not in capsys.readouterr().out
    assert Recording.read(out).q.min() < -2.39


@pytest.mark.parametrize("seed", range(3))
def test_the_clock_by_which_joints_were_read_counts_and_uneven_reads_keep_their_stamps(seed):
    """Even reads that arrive late by up to 1.4 ms, encoder counts of 1e-5 rad."""
    rng = np.random.default_rng(seed)
    t, path, _ = motion(0.0)
    read = {name: np.round(q, 5) for name, q in path.items()}
    late = t + np.minimum(rng.exponential(0.35e-3, len(t)), 1.2e-3)
    even, sentence = evened({"t": late, **read})
    assert "their own clock restored" in sentence[0]
    assert np.diff(even["t"]) == pytest.approx(0.002, rel=1e-3)
    assert all(np.array_equal(even[name], q) for name, q in read.items())
    rng = np.random.default_rng(seed)
    t = np.arange(6000) / 500.0 + rng.uniform(-0.4e-3, 0.4e-3, 6000)
    even, sentence = evened({"t": t, "q1": np.round(np.sin(4.0 * t), 5)})
    assert "resampled" in sentence[0]
    assert np.abs(even["q1"] - np.sin(4.0 * even["t"])).max() < 3e-5


HEADED = {
    "commas": b"t,fx,fy\n1.5,2.5,3\n4,5.5,6\n",
    "commas and blanks": b"t, fx, fy\n1.5, 2.5, 3\n4, 5.5, 6\n",
    "semicolons": b"t;fx;fy\r\n1.5;2.5;3\r\n4;5.5;6\r\n",
    "decimal commas": b"t;fx;fy\n1,5;2,5;3\n4;5,5;6\n",
    "tabs": b"t\tfx\tfy\n1.5\t2.5\t3\n4\t5.5\t6\n",
    "tabs and blanks": b"t fx \t fy\n1.5\t2.5   3\n 4  5.5\t6\n",
    "a comment": b"# t fx fy\n1.5 2.5 3\n4 5.5 6\n",
    "notes before": b"Sensor: Gamma, SI-65\nrate = 100 Hz\n\nt,fx,fy\n1.5,2.5,3\n4,5.5,6\n",
    "a separator at the end": b"t,fx,fy,\n1.5,2.5,3,\n4,5.5,6,\n",
    "quotes": b'"t","fx","fy"\n"1.5","2.5","3"\n"4","5.5","6"\n',
    "UTF-8 with mark": b"\xef\xbb\xbft,fx,fy\n1.5,2.5,3\n4,5.5,6\n",
    "UTF-16": "t;fx;fy\n1,5;2,5;3\n4;5,5;6\n".encode("utf-16"),
    "UTF-16 without mark": "t,fx,fy\n1.5,2.5,3\n4,5.5,6\n".encode("utf-16-le"),
    "UTF-16, large end first": "t,fx,fy\n1.5,2.5,3\n4,5.5,6\n".encode("utf-16-be"),
}


def table(folder: Path, content: bytes, **options):
    path = folder / "log.csv"
    path.write_bytes(content)
    return read_text(path, **options)


@pytest.mark.parametrize("content", HEADED.values(), ids=HEADED)
def test_a_table_is_found_however_it_is_written(tmp_path, content):
    found = table(tmp_path, content)
    read = {name: found.numbers(name).tolist() for name in found.table.column_names}
    assert read == {"t": [1.5, 4.0], "fx": [2.5, 5.5], "fy": [3.0, 6.0]}


def test_tables_have_names_of_any_encoding_or_numbers_and_keep_text_and_digits(tmp_path):
    found = table(tmp_path, "Zeit (µs);Größe\n1;2,5\n2;3\n".encode("cp1252"))
    assert found.table.column_names == ["Zeit (µs)", "Größe"]
    found = table(tmp_path, b"1 2 3\n4 5 6\n")
    assert found.numbers("3").tolist() == [3.0, 6.0]
    found = table(tmp_path, b"time,fx,state\n0,1,ok\n1,2,held\n")
    assert found.numbers("fx").tolist() == [1.0, 2.0]
    with pytest.raises(MapError, match="column 'state', row 0: 'ok' is no number"):
        found.numbers("state")
    assert table(tmp_path, b"1:2\n3:4\n", separator=":").numbers("2").tolist() == [2.0, 4.0]
    at = 1_708_857_503_929_545
    found = table(tmp_path, f"{at} 1.5\n{at + 1} 2.5\n".encode())
    assert np.diff(found.table.column("1").to_numpy()).tolist() == [1]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"t,fx\n1,2\n2,x\n3,4\n", r"column 'fx', row 1: 'x' is no number \(line 3\)"),
        (b"t,fx\n1,2\n2,1e999\n3,4\n", r"column 'fx', row 1: .* not finite \(line 3\)"),
        (b"t,fx\nx,2\n2,3\n3,4\n4,5\n", r"column 't', row 0: 'x' is no number \(line 2\)"),
        (b"1,2\n2,nan\n", r"column '2', row 1: the value is missing or not finite \(line 2\)"),
        (b"t,fx\n1,2\n\n2,\n", r"column 'fx', row 1: .* missing or not finite \(line 4\)"),
        (b"t,fx,fy\n1,2,3\n1,2\n1,2,3\n", r"row 1 \(line 3\) has 2 cells, the rows before it 3"),
        (b"t,fx\n", "0 rows"),
        (b"", "0 rows"),
        (b"\x00\x01\x02" * 99, "is not text"),
        (b"\x1f\x8b\x08" + b"\x00" * 99, "is packed"),
    ],
    ids=str,
)
def test_a_cell_is_blamed_on_its_own_row(tmp_path, content, words):
    with pytest.raises(MapError, match=words):
        found = table(tmp_path, content)
        for name in found.table.column_names:
            found.numbers(name)


@pytest.mark.parametrize("mark", [",", ";", "\t", " "])
def test_a_file_longer_than_what_its_layout_is_read_from(tmp_path, mark, monkeypatch):
    rows = np.random.default_rng(1).normal(size=(400, 3)).round(6)
    lines = [mark.join("abc"), *(mark.join(map(str, row)) for row in rows)]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["# made by a test", *lines]) + "\n")
    monkeypatch.setattr(text_table, "_HEAD", 2000)
    found = read_text(path)
    assert found.skipped == 2
    assert np.array_equal(np.stack([found.numbers(c) for c in "abc"], axis=1), rows)
    with path.open("a") as stream:
        stream.write(mark.join(["1", "x", "2"]) + "\n")
    with pytest.raises(MapError, match=r"column 'b', row 400: 'x' is no number \(line 403\)"):
        read_text(path).numbers("b")


@pytest.mark.parametrize("seed", range(3))
def test_arrival_later_than_the_next_frame_and_lost_rows_are_told_apart(seed):
    """Even reads that arrive late by 0.8 ms on average of 2 ms, in turn, 2 % of which are lost."""
    rng = np.random.default_rng(seed)
    t, path, _ = motion(0.0)
    late = np.maximum.accumulate(t + rng.exponential(0.8e-3, len(t))) + 1e-9 * np.arange(len(t))
    keep = np.append(True, rng.random(len(t) - 1) > 0.02)
    columns = {name: np.round(q, 5)[keep] for name, q in path.items()}
    even, sentence = evened({"t": late[keep], **columns})
    assert "their own clock restored" in sentence[0] and "dropped frames" in sentence[1]
    off = np.abs(even["q1"] - np.sin(4.0 * (even["t"] - even["t"][0])))
    assert np.quantile(off, 0.995) < 2e-4 and off.max() < 0.009  # a frame's way is 0.008
