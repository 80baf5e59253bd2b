"""Recordings that cannot answer: a diagnosis says why and what to do, and never names a cause."""

import json
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import wrenchbed as wb
from wrenchbed import registry
from wrenchbed.campaigns.recording.run import record
from wrenchbed.cli import main
from wrenchbed.data import parquet
from wrenchbed.data.metadata import SensorInfo, ToolInfo
from wrenchbed.data.plan import Plan
from wrenchbed.diagnosis.diagnose import diagnose
from wrenchbed.diagnosis.prepare.prepare_recording import prepare
from wrenchbed.errors import DiagnosisError, RecordingError
from wrenchbed.hardware.drivers.sim import SimDriver, SimOptions
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.simulation.closed_form import Model, robot_of

FORCES, TORQUES = CHANNELS[:3], CHANNELS[3:]
POSES, ROWS = 40, 20
UP = (0.0, 0.0, 9.80665)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Sound recordings at rest: of both robots, and of a UR5 with 3 kg more than stated."""
    folder, made = tmp_path_factory.mktemp("sound"), {}
    for name, robot, effects in (
        ("ur5", "ur5", ()),
        ("medrue", "medrue", ()),
        ("heavy", "ur5", ("tool.mass:mass=3",)),
    ):
        q = registry.load("robots", robot).sample(POSES, np.random.default_rng(1))
        path = folder / f"{name}.parquet"
        with SimDriver(SimOptions(robot, noise="white", seed=1, effects=effects)) as driver:
            record(driver, Plan.of(robot, q), path, samples=ROWS)
        made[name] = wb.Recording.read(path)
    return made


@pytest.fixture
def ur5(recordings):
    return recordings["ur5"]


def changed(recording, columns=None, **metadata):
    """The recording with other columns and other metadata, in a file of its own name."""
    stated = replace(recording.metadata, **metadata)
    return wb.Recording(stated, {**recording.columns, **(columns or {})}, "rec.parquet")


def rows(recording, keep):
    """The recording with some of its rows."""
    some = {k: v[keep] for k, v in recording.columns.items()}
    return wb.Recording(recording.metadata, some, "rec.parquet")


def turned_over(recording, channels):
    return {c: -recording.columns[c] for c in channels}


def in_degrees(recording, joints):
    return {j: np.rad2deg(recording.columns[j]) for j in joints}


def noise(recording, seed=0):
    std = recording.metadata.sensor.noise_std
    return np.random.default_rng(seed).standard_normal((len(recording), 6)) * std


def refused(recording, *words):
    with pytest.raises(DiagnosisError) as caught:
        diagnose(recording)
    told = str(caught.value)
    assert "\n" not in told and told.startswith("rec.parquet: ")
    for word in words:
        assert word in told
    return told


@pytest.mark.slow
def test_sound_recordings_are_not_refused(recordings):
    for recording in recordings.values():
        assert len(prepare(recording).y) == POSES


@pytest.mark.slow
def test_too_few_poses(ur5):
    few = rows(ur5, ur5.columns["segment"] < 8)
    refused(few, "8 poses cannot separate causes", "record at least 12")


@pytest.mark.parametrize("segments", [True, False])
def test_one_orientation_however_often(ur5, segments):
    again = {c: np.tile(ur5.columns[c][:ROWS], 80) for c in (*ur5.joints, *CHANNELS)}
    again["t"] = np.arange(80.0 * ROWS)
    if segments:
        again["segment"] = np.repeat(np.arange(80), ROWS)
    same = wb.Recording(ur5.metadata, again, "rec.parquet")
    if segments:
        refused(same, "nearly the same orientation", "Turn the tool about")
    else:
        refused(same, "1 poses cannot separate causes")


def test_no_repeats_and_no_noise_stated(ur5):
    once = rows(ur5, np.arange(len(ur5)) % ROWS == 0)
    silent = changed(once, sensor=replace(once.metadata.sensor, noise_std=None))
    refused(
        silent, "cannot distinguish a gap from noise", "State it, or record several rows a pose"
    )


@pytest.mark.parametrize("channel", ["fx", "tz"])
def test_a_constant_channel(ur5, channel):
    stuck = changed(ur5, {channel: np.full(len(ur5), 3.2)})
    refused(stuck, f"column '{channel}' is 3.2 in every row", "check the column map")


def test_a_channel_that_sticks_on_the_way(ur5):
    column = ur5.columns["fy"].copy()
    column[500:] = column[500]
    refused(changed(ur5, {"fy": column}), "column 'fy'", "from row 500 on", "stuck")


@pytest.mark.parametrize("channel", ["fx", "tz"])
def test_a_dead_channel_that_still_rustles(ur5, channel):
    k = CHANNELS.index(channel)
    dead = changed(ur5, {channel: 3.2 + noise(ur5)[:, k]})
    refused(dead, f"column '{channel}' does not follow its load", "Repair it")


@pytest.mark.parametrize("tilt", [0.0, 0.01, 0.03])
def test_a_torque_without_lever_is_no_dead_channel(recordings, tilt):
    """Also not where the base leans: a load without tz then has its CoG a little off the axis."""
    robot = registry.load("robots", "ur5")
    states = {"tool.cog.x": 0.0, "tool.cog.y": 0.0, "base.tilt.x": tilt}
    sound = recordings["ur5"]
    tool = replace(sound.metadata.tool, cog=(0.0, 0.0, 0.071))
    theta = robot.parameters.vector(states)
    wrench = Model.of(robot).predict(sound.q, np.append(theta, _sensor())) + noise(sound)
    columns = dict(zip(CHANNELS, wrench.T, strict=True))
    assert len(prepare(changed(sound, columns, tool=tool)).y) == POSES


def _sensor():
    return Model.of(registry.load("robots", "ur5")).parameters.nominal[-15:]


def test_a_channel_clipped_at_the_end_of_its_range(recordings):
    heavy = recordings["heavy"]
    clipped = changed(heavy, {"fx": np.clip(heavy.columns["fx"], -32.0, 32.0)})
    refused(clipped, "column 'fx'", "row ", "SI-32-2.5 of ati-gamma", "Choose a larger range")


def test_a_channel_clipped_at_one_end_only(ur5):
    level = np.quantile(ur5.columns["fx"], 0.8)
    clipped = changed(ur5, {"fx": np.minimum(ur5.columns["fx"], level)})
    refused(clipped, "column 'fx'", "row ", f"exactly {level:g}", "larger range")


def test_a_channel_clipped_most_of_the_time(ur5):
    level = np.quantile(ur5.columns["tx"], 0.6)
    clipped = changed(ur5, {"tx": np.minimum(ur5.columns["tx"], level)})
    refused(clipped, "column 'tx'", "saturated", "Choose a larger range")


def test_a_level_in_both_directions_is_named(ur5):
    level = np.quantile(np.abs(ur5.columns["fx"]), 0.8)
    clipped = changed(ur5, {"fx": np.clip(ur5.columns["fx"], -level, level)})
    told = diagnose(clipped).diagnosis.to_json()
    assert [w["effect"] for w in told["which"]] == ["sensor.saturation"]
    found = told["which"][0]["parameters"]
    # against the calibrated simulator, whose tool is lighter by the share that exceeds 1
    held = found["level.fx"]["value"] * found["share.fx"]["value"]
    assert held == pytest.approx(level, rel=0.002)


def test_a_robot_that_does_not_exist(ur5):
    refused(changed(ur5, robot="ur55"), "metadata robot = 'ur55'", "did you mean 'ur5'?")


def test_a_ur5_called_a_medrue(ur5):
    refused(changed(ur5, robot="medrue"), "row 0: q", "outside its limits", "robot = 'medrue'")


@pytest.mark.parametrize("side", ["lower", "upper"])
def test_an_encoder_may_read_a_little_past_a_limit(ur5, side, monkeypatch):
    monkeypatch.setattr(parquet, "ROWS_AT_ONCE", 2)
    limit = getattr(registry.load("robots", "ur5").joints[1], side)
    way = 1.0 if side == "upper" else -1.0
    at = {"q2": np.where(np.arange(len(ur5.t)) < 3, limit + way * 0.9e-3, ur5.q[:, 1])}
    assert robot_of(changed(ur5, at)).name == "ur5"
    at = {"q2": np.where(np.arange(len(ur5.t)) == 3, limit + way * 1.1e-3, ur5.q[:, 1])}
    with pytest.raises(RecordingError, match="row 3: q2 = .* outside its limits"):
        robot_of(changed(ur5, at))


def test_a_medrue_called_a_ur5(recordings):
    wrong = changed(recordings["medrue"], robot="ur5")
    refused(wrong, "row ", "q6 = ", "outside its limits", "robot = 'ur5'")


def test_a_medrue_called_a_ur5_within_all_limits(recordings):
    medrue = recordings["medrue"]
    inside = rows(medrue, (np.abs(medrue.q) < 6.28).all(axis=1))
    wrong = changed(inside, robot="ur5", sensor=SensorInfo(), tool=ToolInfo())
    refused(wrong, "not as the joints turn 'ur5'", "check metadata robot")


def test_another_number_of_joints(ur5):
    columns = {k: v for k, v in ur5.columns.items() if k != "q6"}
    short = wb.Recording(ur5.metadata, columns, "rec.parquet")
    refused(short, "has 5 joints, ur5 has 6", "metadata robot = 'ur5'")


@pytest.mark.parametrize("robot, first", [("ur5", 1), ("medrue", 2)])
def test_joints_in_degrees(recordings, robot, first):
    sound = recordings[robot]
    wrong = changed(sound, in_degrees(sound, sound.joints[first - 1 :]))
    refused(wrong, "row 0: q2", "is it in degrees?", "state joints in rad and m")


def test_joints_in_millimetres(recordings):
    sound = recordings["medrue"]
    wrong = changed(sound, {"q1": 1e3 * sound.columns["q1"]})
    refused(wrong, "row 0: q1", "is it in mm?")


def test_a_motion_in_degrees(ur5):
    degrees = changed(ur5, in_degrees(ur5, ur5.joints), mode="dynamic")
    refused(degrees, "is it in degrees?")


@pytest.mark.parametrize("robot", ["ur5", "medrue"])
@pytest.mark.parametrize("what", ["gravity", "wrench", "forces"])
def test_a_load_that_pulls_up(recordings, robot, what):
    sound = recordings[robot]
    wrong = {
        "gravity": lambda: changed(sound, gravity=UP),
        "wrench": lambda: changed(sound, turned_over(sound, CHANNELS)),
        "forces": lambda: changed(sound, turned_over(sound, FORCES)),
    }[what]()
    refused(wrong, "mass comes out as -", "opposite sign")


@pytest.mark.parametrize("robot", ["ur5", "medrue"])
def test_torques_of_the_opposite_sign(recordings, robot):
    sound = recordings[robot]
    refused(changed(sound, turned_over(sound, TORQUES)), "torques have the opposite sign")


def test_axes_that_are_swapped(ur5):
    swapped = changed(ur5, {"fx": ur5.columns["fy"], "fy": ur5.columns["fx"]})
    refused(swapped, "columns 'fx' and 'fy' are swapped")


@pytest.mark.parametrize("channels, word", [(FORCES, "in mN"), (TORQUES, "in N·mm")])
def test_other_units_of_the_wrench(ur5, channels, word):
    refused(changed(ur5, {c: 1e3 * ur5.columns[c] for c in channels}), word)


def test_no_load(ur5):
    empty = changed(ur5, dict(zip(CHANNELS, noise(ur5).T, strict=True)))
    refused(empty, "no weight shows", "stated 1.35 kg", "mount the tool")


def test_not_a_number(ur5):
    column = ur5.columns["ty"].copy()
    column[7] = np.nan
    with pytest.raises(RecordingError, match=r"rec\.parquet: column 'ty', row 7: nan is not"):
        changed(ur5, {"ty": column})


def test_time_going_backwards(ur5):
    t = ur5.t.copy()
    t[9] = t[3]
    with pytest.raises(RecordingError, match=r"column 't', row 9: .* does not come after"):
        changed(ur5, {"t": t})


def written(recording, path, bad=None, **raw):
    """The recording as any program may write it: nothing is checked."""
    metadata = recording.metadata.to_json() | raw
    columns = {k: v.copy() for k, v in recording.columns.items()}
    if bad is not None:
        columns[bad[0]][bad[1]] = bad[2]
    table = pa.table(columns)
    text = json.dumps(metadata).encode()
    pq.write_table(table.replace_schema_metadata({b"wrenchbed": text}), path)


CASES = {
    "few poses": (lambda r: rows(r, r.columns["segment"] < 8), {}, "record at least 12"),
    "degrees": (lambda r: changed(r, in_degrees(r, r.joints)), {}, "is it in degrees?"),
    "gravity up": (lambda r: r, {"gravity": list(UP)}, "opposite sign"),
    "wrong robot": (lambda r: r, {"robot": "medrue"}, "outside its limits"),
    "stuck": (lambda r: changed(r, {"fx": np.full(len(r), 3.2)}), {}, "in every row"),
    "no tool": (lambda r: r, {"tool": {"mass": 0.0}}, "tool.mass = 0.0 must be above 0 kg"),
    "not a number": (lambda r: r, {"bad": ("fz", 11, np.nan)}, "column 'fz', row 11: nan"),
    "time back": (lambda r: r, {"bad": ("t", 9, 0.0)}, "column 't', row 9"),
    "no mode": (lambda r: r, {"mode": "still"}, "must be 'static' or 'dynamic'"),
}


@pytest.mark.parametrize("case", CASES)
def test_one_line_and_nothing_written(ur5, case, tmp_path, capsys):
    make, raw, words = CASES[case]
    path, out = tmp_path / "bad.parquet", tmp_path / "out"
    written(make(ur5), path, **raw)
    assert main(["diagnose", str(path), "--out", str(out)]) == 1
    told = capsys.readouterr()
    (line,) = told.err.strip().splitlines()
    assert told.out == "" and not out.exists()
    assert line.startswith("wrenchbed: error: ") and "bad.parquet" in line and words in line
