"""The monthly check: poses, history, verdicts, what changed; damaged histories are refused."""

import json
import shutil
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pyarrow.parquet as pq
import pytest
from monthly_robot import MonthlyRobot
from scipy import stats

import wrenchbed as wb
from wrenchbed.cli import main
from wrenchbed.errors import HistoryError, RecordingError, WrenchbedWarning
from wrenchbed.monitoring import check as monthly
from wrenchbed.monitoring import history
from wrenchbed.monitoring.steps import _PRIOR, _WALK, FITTED, History
from wrenchbed.planning.collisions import Clearance

UR5 = wb.load("robots", "ur5")


@pytest.fixture(scope="module")
def plan():
    return monthly.choose(UR5)


@pytest.fixture(scope="module")
def healthy(plan):
    """Seven checks of a robot that does not change."""
    return series(MonthlyRobot(UR5, plan, 7), 7)


@pytest.fixture(scope="module")
def kept(plan, tmp_path_factory):
    """A folder with a history of three checks."""
    folder = tmp_path_factory.mktemp("kept")
    plan.write(folder / monthly.PLAN)
    for month in range(3):
        wb.check(UR5, folder, MonthlyRobot(UR5, plan, 7).recording(month))
    return folder


@pytest.fixture
def folder(kept, tmp_path):
    """A copy of it."""
    return shutil.copytree(kept, tmp_path / "cell")


def series(robot, months):
    return [history.taken(robot.recording(m), UR5, robot.plan) for m in range(months)]


def changed_names(judgement):
    return {c.name for c in judgement.comparison.changes if c.changed}


def headline(judgement):
    return judgement.comparison.sentences[0]


@pytest.mark.parametrize("name", ["ur5", "medrue"])
def test_the_poses_of_a_check_touch_nothing_and_end_where_they_begin(name):
    robot = wb.load("robots", name)
    q = monthly.choose(robot).q
    assert len(q) == 12 and np.array_equal(q[0], q[-1])
    clearance = Clearance(robot)
    assert not any(clearance.hit(each) for each in q)


def test_the_plan_is_chosen_once(folder):
    before = (folder / monthly.PLAN).read_bytes()
    assert np.array_equal(wb.check_plan(UR5, folder).q, wb.Plan.read(folder / monthly.PLAN).q)
    assert (folder / monthly.PLAN).read_bytes() == before
    with pytest.raises(HistoryError, match=r"plan.parquet: is of robot 'ur5', not 'medrue'"):
        wb.check_plan(wb.load("robots", "medrue"), folder)


def test_values_are_those_of_the_simulation(plan, tmp_path):
    """MuJoCo records, with a known load, tilt and bias."""
    truth = {"tool.mass": 1.42, "tool.cog.x": 0.007, "base.tilt.x": 1e-3, "base.tilt.y": -2e-3,
             "sensor.bias.fx": 1.0, "sensor.bias.tz": 0.02}  # fmt: skip
    with wb.SimDriver(wb.SimOptions("ur5", parameters=truth, seed=3)) as link:
        wb.record(link, plan, tmp_path / "r.parquet", samples=200, revisit=False)
    read = wb.Recording.read(tmp_path / "r.parquet")
    recording = history.stated(read, {"time": "2026-01-01T00:00:00Z"})
    fitted = History(UR5, [history.taken(recording, UR5, plan)])
    std = np.hypot(fitted.std, fitted._expected[0])
    stated = UR5.parameters.mapping(UR5.parameters.nominal) | truth
    for name, value, s in zip(FITTED, fitted.values[0], std, strict=True):
        true = stated if name.startswith(("tool", "base", "mount", "span")) else truth
        assert value == pytest.approx(true.get(name, 0.0), abs=5 * s), name


def test_a_step_is_measured(plan):
    """A lighter tool by look-alikes: size and interval."""
    robot = MonthlyRobot(UR5, plan, 11, fault="tool.mass", begins=6)
    step, j = History(UR5, series(robot, 8)).step(6), list(FITTED).index("tool.mass")
    item, amount = robot.cause
    (size,) = item.true.values()
    assert abs(step.size[j] - size * amount) < stats.t.ppf(0.975, step.freedom) * step.std[j]


def test_a_step_is_that_of_generalised_least_squares_by_hand(healthy):
    fitted, j, begin = History(UR5, healthy), 6, 5
    unit, by_kelvin = (x[j] for x in fitted._expected)
    months, n = 12.0 * fitted.years, len(healthy)
    covariance = np.eye(n) + _WALK * np.minimum(months[:, None], months)
    degrees = np.array([c.temperature for c in healthy])
    x = np.column_stack([np.arange(n) >= begin, np.ones(n), degrees - degrees[0]]).astype(float)
    prior = np.diag([0.0, 0.0, 1.0 / by_kelvin**2])
    inverse = np.linalg.inv(x.T @ np.linalg.solve(covariance, x) + prior)
    y = (fitted.values[:, j] - fitted.values[0, j]) / unit
    beta = inverse @ x.T @ np.linalg.solve(covariance, y)
    residual = y - x @ beta
    square = _PRIOR + residual @ np.linalg.solve(covariance, residual) + beta @ prior @ beta
    step = fitted.step(begin)
    assert step.freedom == _PRIOR + n - 2
    assert step.size[j] == pytest.approx(unit * beta[0], rel=1e-6)
    expected = unit * np.sqrt(square / step.freedom * inverse[0, 0])
    assert step.std[j] == pytest.approx(expected, rel=1e-6)


def test_a_zero_that_walks_for_months_is_no_step(plan):
    """0.3 noises of a row a month, which two years add up to 1.5."""
    robot, walk, rng = MonthlyRobot(UR5, plan, 41), np.zeros(6), np.random.default_rng(5)
    std, checks = wb.load("sensors", UR5.sensor).noise.row_std, []
    for new in series(robot, 24):
        walk = walk + rng.normal(0.0, 0.3, 6) * std
        checks.append(replace(new, wrench=new.wrench + walk))
    assert not any(monthly._alarms(History(UR5, checks[:n])) for n in range(2, 25))


def test_first_checks_cannot_tell_and_later_ones_are_healthy(healthy):
    judged = [monthly.judge(UR5, healthy[: k + 1]) for k in range(7)]
    assert [j.verdict for j in judged] == ["cannot tell"] * 3 + ["healthy"] * 4
    assert judged[0].alarms == () and "check 1 since the first check" in headline(judged[0])


@pytest.mark.sampled
@pytest.mark.parametrize(
    "fault", ["sensor.gain", "base.tilt", "tool.mass", "tool.cog", "mount.rotation"]
)
def test_a_change_is_found_and_named(plan, fault):
    robot = MonthlyRobot(UR5, plan, 21, fault=fault, begins=5, gap=4.0)
    judgement = monthly.judge(UR5, series(robot, 6))
    assert judgement.verdict == "changed" and judgement.begin == 5 and judgement.alarms
    names = ("span", "tool.mass") if fault == "sensor.gain" else (fault,)
    assert any(n.startswith(names) for n in changed_names(judgement))
    sigmas = {c.name: abs(c.sigmas) for c in judgement.comparison.changes}
    assert max(sigmas, key=sigmas.get) in headline(judgement)


@pytest.mark.sampled
@pytest.mark.parametrize("fault", ["cable.pull", "joint.offset"])
def test_a_change_that_the_numbers_do_not_explain_is_said_to_be_one(plan, fault):
    judgement = monthly.judge(UR5, series(MonthlyRobot(UR5, plan, 22, fault=fault, begins=5), 6))
    assert judgement.verdict == "changed" and changed_names(judgement)
    assert "what these numbers do not explain" in headline(judgement)


def test_a_change_stays_until_a_new_baseline(plan):
    checks = series(MonthlyRobot(UR5, plan, 23, fault="tool.cog", begins=5), 8)
    judged = monthly.judge(UR5, checks).checks
    assert [c.verdict for c in judged[5:]] == ["changed"] * 3
    renewed = monthly.judge(UR5, [*checks[:7], replace(checks[7], baseline="tool replaced")])
    assert renewed.verdict == "cannot tell" and "since tool replaced" in headline(renewed)


def test_a_recorded_temperature_makes_zeros_sharper(healthy):
    """The same robot with and without the column."""
    blind = [replace(c, temperature=np.nan) for c in healthy]
    warm, cold = (History(UR5, x).step(len(x) - 1).std for x in (healthy, blind))
    assert all(w < c for n, w, c in zip(FITTED, warm, cold, strict=True) if ".bias." in n)


def test_a_history_is_read_from_its_recordings_and_its_table_says_the_same(folder, plan):
    checks = history.read(folder, UR5, plan)
    table = pq.read_table(folder / history.FILE).to_pydict()
    assert table["verdict"] == ["cannot tell"] * 3
    fitted = History(UR5, checks)
    for month, (old, new) in enumerate(
        zip(checks, series(MonthlyRobot(UR5, plan, 7), 3), strict=True)
    ):
        assert np.array_equal(old.wrench, new.wrench) and old.time == new.time
        assert np.array_equal(old.covariance, new.covariance) and np.array_equal(old.q, new.q)
        assert table["recording"][month] == old.recording == new.recording
        assert table["hold03.fz"][month] == old.wrench[3, 2]
        assert table["tool.mass"][month] == pytest.approx(fitted.values[month, 6], abs=1e-5)


@pytest.mark.parametrize("damage", ["cut", "of something else"])
def test_a_damaged_table_is_kept_and_made_again(folder, plan, damage):
    path = folder / history.FILE
    if damage == "cut":
        path.write_bytes(path.read_bytes()[:-1000])
    else:
        plan.write(path)
    damaged = path.read_bytes()
    with pytest.warns(WrenchbedWarning, match=r"history.parquet: holds what recordings does not"):
        found = wb.check(UR5, folder, MonthlyRobot(UR5, plan, 7).recording(3))
    assert found.verdict == "healthy" and pq.read_table(path).num_rows == 4
    assert (folder / (history.FILE + "~")).read_bytes() == damaged


def test_a_check_goes_with_its_recording(folder, plan):
    first, second, third = sorted((folder / "recordings").iterdir())
    second.unlink()
    with pytest.warns(WrenchbedWarning, match=r"it is kept as .*history.parquet~"):
        found = wb.check(UR5, folder, MonthlyRobot(UR5, plan, 7).recording(3))
    names = [f"recordings/{p.name}" for p in (first, third)]
    assert [c.recording for c in found.checks[:2]] == names and found.verdict == "cannot tell"


def test_a_check_that_does_not_continue_its_history_is_refused(folder, plan):
    """A copy, a clock that was set back, other poses, another robot, no time."""
    robot = MonthlyRobot(UR5, plan, 7)
    recording, (*_, last) = robot.recording(5), history.read(folder, UR5, plan)
    moved = wb.Plan.of("ur5", plan.q + np.where(np.arange(12) == 4, 0.1, 0.0)[:, None])
    short = wb.Plan.of("ur5", plan.q[:8])
    metadata = recording.metadata
    for given, year, error, match in (
        (robot.recording(1), 2021, HistoryError, "holds the readings of .*checked already"),
        (robot.recording(3), 2019, HistoryError, r"2019-02-01 .*, recordings/2020\S+ of 2020"),
        (robot.recording(3), 2999, HistoryError, "new check is of 2999.*set the clock right"),
        (MonthlyRobot(UR5, moved, 7).recording(5), None, RecordingError,
         r"pose 4 is not that of .*plan.parquet: record that"),
        (MonthlyRobot(UR5, short, 7).recording(5), None, RecordingError,
         "holds 8 poses; pose 8 is not that of"),
        (replace(recording, metadata=replace(metadata, robot="medrue")), None, RecordingError,
         "is of medrue .static.; a check needs ur5"),
        (replace(recording, metadata=replace(metadata, extra={})), None, HistoryError,
         "states no time; give --time"),
    ):  # fmt: skip
        time = None if year is None else datetime(year, 2, 1, tzinfo=UTC)
        with pytest.raises(error, match=match):
            wb.check(UR5, folder, given, time=time)
    gamma = replace(
        recording, metadata=replace(metadata, sensor=replace(metadata.sensor, model="x"))
    )
    with pytest.raises(HistoryError, match=r"is of x, recordings/2020\S+ of ati-gamma: give each"):
        wb.check(UR5, folder, gamma)
    with pytest.raises(
        HistoryError, match=r"recordings/\S+ of 2020-03-.*clock shows 2020-02-01 .*clock right"
    ):
        history.in_time([last], last.time, datetime(2020, 2, 1, tzinfo=UTC))
    assert len(list((folder / "recordings").iterdir())) == 3


def test_a_recording_that_does_not_fit_is_named_and_left_out(folder, plan):
    known = folder / "recordings"
    (known / "20200214T000000Z.parquet").write_bytes(b"PAR1 cut")
    again = known / "20300101T000000Z.parquet"
    shutil.copy(sorted(known.iterdir())[0], again)
    MonthlyRobot(UR5, plan, 7).recording(9).write(known / "unfinished.parquet")
    with pytest.warns(WrenchbedWarning) as said:
        assert len(history.read(folder, UR5, plan)) == 3
    texts = sorted(str(w.message) for w in said)
    assert "left out: " in texts[0] and "not a complete" in texts[0]
    assert "it was checked already" in texts[1] and len(texts) == 2


@pytest.mark.slow
def test_the_command_checks_the_simulated_robot(tmp_path, capfd):
    folder = str(tmp_path / "cell")

    def run(month, *more):
        words = ["check", "ur5", "--history", folder, "--samples", "50", "--temperature", "21"]
        code = main([*words, "--json", "--time", f"2026-{month:02}-01T06:00:00Z", *more])
        return code, json.loads(capfd.readouterr().out)

    assert main(["check", "ur5", "--history", folder, "--prepare"]) == 0
    assert "12 poses → " in capfd.readouterr().out
    assert not (tmp_path / "cell" / history.FILE).exists()
    assert [run(month)[0] for month in range(1, 5)] == [4, 4, 4, 0]
    code, result = run(5, "--effect", "base.tilt:x=0.004")
    assert code == 3 and result["verdict"] == "changed" and "base.tilt.x" in result["alarms"]
    assert result["before"].startswith("2026-05-01") and result["after"].startswith("2026-04-01")
    numbers = {c["name"]: c for c in result["changes"]}
    tilt = numbers["base.tilt.x"]
    assert tilt["changed"] and not numbers["tool.mass"]["changed"]
    assert tilt["after"] - tilt["before"] == pytest.approx(0.004, abs=4 * tilt["std"])
    assert "base.tilt.x: +" in result["sentences"][0] and " σ)" in result["sentences"][0]
    code, result = run(6, "--new-baseline", "levelled the base", "--out", f"{folder}.html")
    html = (tmp_path / "cell.html").read_text(encoding="utf-8")
    assert "Not known yet" in html and "more below" not in html
    assert code == 4 and result["since"].startswith("2026-06-01") and result["changes"] == []


def test_a_recording_of_the_plan_is_checked(folder, plan, tmp_path, capfd):
    april, page = tmp_path / "april.parquet", tmp_path / "april.html"
    MonthlyRobot(UR5, plan, 7).recording(3).write(april)
    words, recorded = ["check", "ur5", "--history", str(folder)], ["--recording", str(april)]
    assert main([*words, *recorded, "--out", str(page)]) == 0
    text, shown = page.read_text(encoding="utf-8"), capfd.readouterr().out
    assert "✓ healthy" in text and 'id="course"' in text and "Check of ur5, 2020-04-1" in text
    assert "healthy: no change in 4 checks since 2020-01-1" in shown and "tool.mass" in shown
    for more, why in ((recorded, "it was checked already"), (["--seed", "-1"], "seed -1 must not")):
        assert main([*words, *more]) == 1
        assert why in capfd.readouterr().err


@pytest.mark.study
@pytest.mark.parametrize("warm", [True, False])
def test_false_alarms_are_rare(plan, warm):
    """Ten healthy robots for five years; 1 % a robot-year allow 0.5 alarms."""
    alarms = 0
    for seed in range(9000, 9010):
        checks = series(MonthlyRobot(UR5, plan, seed, warm=warm), 60)
        alarms += any(monthly._alarms(History(UR5, checks[:n])) for n in range(2, 61))
    assert alarms <= 2
