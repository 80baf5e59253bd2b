"""`import --guess`: recordings in random conventions, real ones, and refusals."""

import re
from collections import Counter
from fnmatch import fnmatch

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import ntnu
import wrenchbed as wb
from wrenchbed.cli import main
from wrenchbed.data import column_map
from wrenchbed.data.guess import candidates
from wrenchbed.data.guess.convention import gather
from wrenchbed.data.guess.guess import Guess, guess
from wrenchbed.data.guess.user_facts import Stated
from wrenchbed.data.import_files import import_files, merged, sensor_by_joints
from wrenchbed.errors import MapError
from wrenchbed.physics.wrench import CHANNELS
from written_logs import Written, write

OFF = 0.03
"""Errors of gravity and wrench, relative to their size, of a map that is right."""

QUANTITIES = {"t": "time"} | dict(zip(CHANNELS, ["force"] * 3 + ["torque"] * 3, strict=True))
"""What the columns of a map's targets are; the others are of orientations and joints."""


def reads(found: Guess, k: int, log: Written) -> bool:
    """Whether a guessed map gives the wrench and gravity that were written."""
    mapping = found.column_map(k)
    data, left, name, _ = merged(log.files, mapping)
    if len(data["t"]) + left != len(log.wrench):
        return False
    if "qw" in data:
        turn = Rotation.from_quat(np.stack([data[c] for c in ("qx", "qy", "qz", "qw")], axis=1))
    else:
        turn = sensor_by_joints(data, mapping.metadata, name)
    gravity = turn.inv().apply(mapping.metadata.gravity)
    wrench = np.stack([data[c] for c in CHANNELS], axis=1)
    size = np.repeat([np.ptp(log.wrench[:, :3]), np.ptp(log.wrench[:, 3:])], 3)
    return bool(
        np.sqrt(np.mean((gravity - log.gravity) ** 2)) < OFF * 9.8
        and (np.sqrt(np.mean((wrench - log.wrench) ** 2, axis=0)) < OFF * size).all()
    )


def guessed(log: Written, robot: str | None = None) -> Guess:
    """What is guessed; a refusal that asks for the tool's mass gets what kitchen scales show."""
    try:
        return guess(log.files, Stated(robot=robot))
    except MapError as error:
        if "--tool-mass KG decides" not in str(error):
            raise
        return guess(log.files, Stated(robot=robot, tool_mass=1.02 * log.mass))


def judged(folder, seed: int) -> tuple[bool, str]:
    """Whether a map that is named is right, and the story."""
    log = write(folder, seed)
    found = guessed(log)
    right = any(reads(found, k, log) for k in range(len(found.maps)))
    return right, f"{log.text} → {found.conventions[0].sentence}"


def answered(folder, seed: int, named: bool) -> tuple[str, str]:
    """How a wide draw is answered, and the story.

    ``first`` or ``named``: the right map is the first, or one of the named; ``refused``: exit 1;
    ``wrong``: exit 0 without the right one; ``dimension``: a column is read as another quantity.
    """
    log = write(folder, seed, named)
    try:
        found = guessed(log, None if log.robot == "ur5" else log.robot)
    except MapError as error:
        return "refused" if log.mappable else "rightly refused", f"{log.text} → {error}"
    story = f"{log.text} → {found.conventions[0].sentence}"
    for entry in found.maps[0]["file"]:
        file = next(f.name for f in log.files if fnmatch(f.name, entry["match"]))
        for target, column in entry["columns"].items():
            quantity = QUANTITIES.get(target, "turn")
            if log.quantities[file][column["column"]] != quantity:
                return "dimension", f"{story}: {target} from {column['column']}"
    right = log.mappable and [reads(found, k, log) for k in range(len(found.maps))]
    if right and any(right):
        return "first" if right[0] else "named", story
    return "wrong", story


@pytest.mark.study
@pytest.mark.parametrize("named", [True, False], ids=["names", "no names"])
def test_wide_draws_are_answered_rightly_or_refused(tmp_path, named):
    answers: Counter[str] = Counter()
    for seed in range(3000, 3200):
        (tmp_path / str(seed)).mkdir()
        answers[answered(tmp_path / str(seed), seed, named)[0]] += 1
    mappable = answers.total() - answers["rightly refused"]
    right = answers["first"] + answers["named"]
    assert right >= (0.98 if named else 0.95) * mappable, answers
    assert answers["dimension"] == 0 and answers["wrong"] <= 0.005 * answers.total(), answers


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("seed", "named", "answer"),
    [
        (2, True, "first"),  # mN and mN·m in its names
        (29, True, "rightly refused"),  # counts
        (25, False, "rightly refused"),  # a weight that is compensated, beside twelve other columns
        (4260, True, "rightly refused"),  # the same, in radians without a unit: a constant fits
        (8, False, "named"),  # kgf
        (3005, True, "rightly refused"),  # compensated, in base axes: as a weight if turned back
        (3189, False, "first"),  # gf and gf·cm, which are 51 kg in N
    ],
)
def test_a_wide_draw_is_answered_rightly_or_refused(tmp_path, seed, named, answer):
    assert answered(tmp_path, seed, named)[0] == answer


@pytest.mark.sampled
@pytest.mark.parametrize("seed", [*range(5), 2014, 2051])  # two tables without names
def test_a_random_convention_is_found(tmp_path, seed):
    named, story = judged(tmp_path, seed)
    assert named, story


def test_conventions_that_no_data_tell_apart_are_named():
    files = [ntnu.DATA / "0-calibration_fts-accel.csv"]
    lines = "\n".join(guess(files).lines)
    assert "fits equally well: matrix" in lines and "sign = -1" in lines
    assert "kgf and kgf·m (9.14 kg)" in lines and "--tool-mass KG decides" in lines
    told = guess(files, Stated(tool_mass=9.1))
    assert {c.units[0] for c in told.conventions} == {"kgf"}
    assert told.conventions[0].mass == pytest.approx(9.1, rel=0.05)
    for mass in (0.0, -1.0, np.nan):
        with pytest.raises(MapError, match=f"--tool-mass {mass:g} must be above 0"):
            guess(files, Stated(tool_mass=mass))
    with pytest.raises(MapError, match=r"a tool of 3 kg at .* m; in N it is 0\.932 kg"):
        guess(files, Stated(tool_mass=3.0))


def test_the_real_poses_come_in_by_one_line_and_calibrate_as_before(tmp_path):
    file, rest = ntnu.DATA / "0-calibration_fts-accel.csv", ntnu.DATA / "0-steady-state_wrench.csv"
    line = ["import", str(file), "--guess", "--robot", "kuka-lbr-med14", "--sensor", "ati-gamma"]
    out = tmp_path / "static.parquet"
    assert main([*line, "--rest", str(rest), "--out", str(out)]) == 0
    found = wb.Recording.read(out)
    wanted = ntnu.static()
    for name, column in wanted.columns.items():
        assert np.allclose(found.columns[name], column, rtol=0, atol=1e-12), name
    assert found.metadata.gravity == wanted.metadata.gravity
    assert found.metadata.sensor.model == "ati-gamma"
    assert np.allclose(found.metadata.sensor.noise_std, wanted.metadata.sensor.noise_std, rtol=4e-3)
    fits = [wb.calibrate(r) for r in (found, wanted)]
    for a, b in zip(fits[0].identified, fits[1].identified, strict=True):
        assert abs(a.value - b.value) < 0.02 * b.std and abs(a.std - b.std) < 0.02 * b.std
    # the map that was written does the same again
    again = import_files([file], column_map.read(tmp_path / "static.map.toml")).recording
    assert again.metadata == found.metadata


@pytest.mark.slow
@pytest.mark.parametrize("run", ["1-baseline", "2-vibrations", "3-vibrations-contact"])
def test_the_real_motions_come_in_by_one_line(tmp_path, run):
    wb.calibrate(ntnu.static()).write(tmp_path / "fit.json")
    files = [ntnu.DATA / f"{run}_{k}.csv" for k in ("accel", "orientations", "wrench")]
    out = tmp_path / "run.parquet"
    line = ["import", *map(str, files), "--guess", "--fit", str(tmp_path / "fit.json")]
    assert main([*line, "--gravity", "9.82085", "--out", str(out)]) == 0
    found = wb.Recording.read(out)
    wanted = import_files(files, column_map.read(ntnu.DATA / "motion.toml")).recording
    rows = min(len(found), len(wanted))
    offset = len(wanted) - rows if abs(len(found) - len(wanted)) else 0
    assert abs(len(found) - len(wanted)) < 10 and found.metadata.mode == "dynamic"
    assert np.abs(found.wrench[:rows] - wanted.wrench[:rows]).max() < 1e-3 or offset
    assert found.metadata.tool.mass == pytest.approx(wanted.metadata.tool.mass, abs=1e-4)
    for axis in ("ax", "ay", "az"):  # the clock of the accelerometer is found within 3 ms
        a, b = found.columns[axis][:rows], wanted.columns[axis][:rows]
        assert np.corrcoef(a, b)[0, 1] > 0.5, axis
    std = np.asarray(found.metadata.sensor.noise_std)
    assert (std < 4.0 * np.asarray(wanted.metadata.sensor.noise_std)).all()


def save(folder, name, columns):
    rows = np.stack(list(columns.values()), axis=1)
    np.savetxt(folder / name, rows, delimiter=",", header=",".join(columns), comments="")
    return folder / name


def random_columns(n=30, seed=0):
    rng = np.random.default_rng(seed)
    q = Rotation.random(n, rng=rng).as_quat()
    columns = {f"q{c}": q[:, k] for k, c in enumerate("xyzw")}
    return columns | {c: rng.normal(size=n) for c in CHANNELS}


@pytest.mark.parametrize(
    ("leave", "words"),
    [
        ((), "the weight of one rigid load|weight of a rigid load"),
        (("fx", "fy"), "no six columns that might be a wrench"),
        (("qx", "qy", "qz", "qw"), "joints need --robot NAME"),
    ],
)
def test_what_is_missing_is_named(tmp_path, leave, words):
    columns = {k: v for k, v in random_columns().items() if k not in leave}
    with pytest.raises(MapError, match=words):
        guess([save(tmp_path, "log.csv", columns)])
    with pytest.raises(MapError, match="no column changes"):
        guess([save(tmp_path, "log.csv", {k: 0.0 * v for k, v in columns.items()})])


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ([ntnu.DATA / "static.toml"], "give files, and either --map MAP or --guess"),
        ([ntnu.DATA, "--guess", "--map", "ur-rtde"], "give files, and either --map MAP or --guess"),
        (["--guess"], "give files, and either"),
        ([ntnu.DATA, "--map", "ur-rtde", "--tool-mass", "1"], "--tool-mass belongs to --guess"),
    ],
)
def test_options_that_do_not_go_together_are_refused(tmp_path, capsys, more, words):
    out = tmp_path / "rec.parquet"
    assert main(["import", *map(str, more), "--out", str(out)]) == 1
    assert words in capsys.readouterr().err


def test_the_wrench_with_the_weight_is_taken_though_torques_stand_first(tmp_path):
    robot = wb.load("robots", "ur5")
    rng = np.random.default_rng(2)
    q = robot.sample(30, rng)
    force = np.array([0.0, 0.0, -14.0]) @ robot.sensor_pose(q, robot.parameters.nominal)[0]
    load = np.hstack([force, np.cross([0.01, 0.0, 0.07], force)]) + 0.02 * rng.normal(size=(30, 6))
    columns = {f"actual_TCP_force_{k}": 0.02 * rng.normal(size=30) for k in range(6)}
    columns |= {f"actual_q_{k}": q[:, k] for k in range(6)}
    columns |= {f"target_q_{k}": q[:, k] for k in range(6)}
    columns |= {f"ft_raw_wrench_{k}": load[:, k] for k in range(6)}
    found = guess([save(tmp_path, "log.csv", columns)])
    assert found.maps[0]["recording"]["robot"] == "ur5"
    assert found.maps[0]["file"][0]["columns"]["fz"]["column"] == "ft_raw_wrench_2"
    assert found.maps[0]["file"][0]["columns"]["q4"] == {"column": "actual_q_3", "unit": "rad"}
    columns = turned_load()
    order = [*(f"q{c}" for c in "xyzw"), "tx", "ty", "tz", "fx", "fy", "fz"]
    np.savetxt(tmp_path / "log.txt", np.stack([columns[c] for c in order], axis=1))
    found = guess([tmp_path / "log.txt"])
    assert found.maps[0]["file"][0]["columns"]["fx"]["column"] == "8"
    assert found.conventions[0].mass == pytest.approx(12.0 / 9.80665, rel=0.01)


def turned_load(n=20):
    """Columns of orientations and of the weight of a load, with a little noise."""
    columns = random_columns(n)
    turn = Rotation.from_quat(np.stack([columns[f"q{c}"] for c in "xyzw"], axis=1))
    force = turn.inv().apply([0.0, 0.0, -12.0])
    load = np.hstack([force, np.cross([0.01, 0.02, 0.06], force)])
    load += 0.01 * np.random.default_rng(5).normal(size=load.shape)
    return columns | dict(zip(CHANNELS, load.T, strict=True))


def test_a_zero_of_a_wrench_in_base_axes_is_as_large_along_each_axis_of_the_sensor(tmp_path):
    columns = turned_load()
    turn = Rotation.from_quat(np.stack([columns[f"q{c}"] for c in "xyzw"], axis=1))
    load = np.stack([columns[c] + 4.0 * k for k, c in enumerate(CHANNELS)], axis=1)
    base = np.hstack([turn.apply(part) for part in np.hsplit(load, 2)])
    columns |= dict(zip(CHANNELS, base.T, strict=True))
    recording = guess([save(tmp_path, "log.csv", columns)]).maps[0]["recording"]
    zero = recording["tolerance"]["sensor.bias"]
    assert len({*zero[:3]}) == len({*zero[3:]}) == 1 and zero[0] > 20.0


def test_what_is_no_ground_for_a_guess_is_named(tmp_path):
    columns = turned_load()
    columns["fx"][5] = np.nan
    with pytest.raises(MapError, match=r"not used: column 'fx', row 5: the value is missing"):
        guess([save(tmp_path, "log.csv", columns)])
    columns = turned_load()
    columns |= {f"q{c}": np.full(20, 0.5) for c in "xyzw"}
    with pytest.raises(MapError, match="poses in different orientations are needed"):
        guess([save(tmp_path, "log.csv", columns)])
    with pytest.raises(MapError, match="5 poses are too few to distinguish conventions"):
        guess([save(tmp_path, "log.csv", turned_load(5))])
    columns = {n if n not in CHANNELS else f"{n} [counts]": c for n, c in turned_load().items()}
    with pytest.raises(MapError, match=r"'fx \[counts\]' is in 'counts', .* give --map"):
        guess([save(tmp_path, "log.csv", columns)])
    with pytest.raises(MapError, match="give --map, a file or one of .*ros-ur5"):
        guess([tmp_path / "r.mcap"])
    columns = {f"joint_{k}": v for k, v in enumerate(np.random.default_rng(0).normal(size=(6, 50)))}
    wrench = {k: v for k, v in random_columns(50).items() if k in CHANNELS}
    with pytest.raises(MapError, match=r"'ur55' is none; did you mean 'ur5'"):
        guess([save(tmp_path, "log.csv", columns | wrench)], Stated(robot="ur55"))


def with_gyroscope(n=30):
    """Time, orientation, force, gyroscope, torque and accelerometer: 18 columns with a counter."""
    columns, rng = turned_load(n), np.random.default_rng(8)
    force, torque = (np.stack([columns[f"{k}{a}"] for a in "xyz"], axis=1) for k in "ft")
    q = np.stack([columns[f"q{c}"] for c in "xyzw"], axis=1)
    read = -9.81 * force / np.linalg.norm(force, axis=1)[:, None] + 0.03 * rng.normal(size=(n, 3))
    gyro = 0.02 * rng.normal(size=(n, 3))
    return np.arange(n) * 0.5, q, force, gyro, torque, read, np.arange(n) % 7


@pytest.mark.parametrize("order", [(1, 2, 3, 5, 4), (1, 2, 3, 4, 5), (3, 5, 4, 1, 2)], ids=str)
def test_force_and_torque_apart_without_names_are_refused_not_made_up(tmp_path, order):
    parts = with_gyroscope()
    values = np.column_stack([parts[0], *(parts[k] for k in order), parts[6]])
    np.savetxt(tmp_path / "log.txt", values, fmt="%.6f")
    with pytest.raises(MapError, match="in the torque|weight of a rigid load"):
        guess([tmp_path / "log.txt"])


@pytest.mark.slow
def test_a_load_is_found_among_46_columns_without_names_and_the_search_is_bounded(
    tmp_path, monkeypatch
):
    rng = np.random.default_rng(1)
    columns, loaded = rng.normal(size=(120, 46)), turned_load(120)
    turn = Rotation.from_quat(np.stack([loaded[f"q{c}"] for c in "xyzw"], axis=1))
    columns[:, 5:8] = turn.as_rotvec()
    load = np.stack([loaded[c] for c in CHANNELS], axis=1)
    columns[:, 20:26] = load + rng.normal(size=load.shape) * np.repeat([0.05, 0.002], 3)
    np.savetxt(tmp_path / "log.csv", columns, delimiter=",", fmt="%.6f")
    fitted, tried = candidates._fitted, []
    monkeypatch.setattr(candidates, "_fitted", lambda *pair: tried.append(pair) or fitted(*pair))
    found = guess([tmp_path / "log.csv"])
    assert found.conventions[0].reading.names == ("6", "7", "8")
    assert [*found.conventions[0].pairing.wrench.values()] == [str(k) for k in range(21, 27)]
    assert found.conventions[0].mass == pytest.approx(12.0 / 9.80665, rel=0.01)
    assert len(tried) <= candidates.MOST_TRIED
    assert re.search(r"of 2\d,\d{3} pairs of .* the 40 that agree best", found.lines[-1])


def test_a_slow_move_of_many_rows_is_not_taken_for_few_poses():
    t = np.arange(20_000) / 500.0
    turn = np.stack([np.mod(t / 7.0 + k, 1.0) for k in range(3)], axis=1)  # jumps, then creeps
    assert gather(t, turn, np.zeros((len(t), 6))).mode == "dynamic"
