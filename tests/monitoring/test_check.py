"""The monthly check: poses, history, verdicts, causes; damaged histories are refused."""

import json
import shutil
import warnings
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy import stats

import wrenchbed as wb
from wrenchbed.benchmark.lookalikes.months import MonthlyRobot
from wrenchbed.cli import main
from wrenchbed.errors import HistoryError, PlanError, RecordingError, WrenchbedWarning
from wrenchbed.monitoring.health import check as health
from wrenchbed.monitoring.health import history, poses, trends
from wrenchbed.monitoring.health.page import page
from wrenchbed.monitoring.health.quantities import QUANTITIES, Basis
from wrenchbed.robots.motion_limits import duration

UR5 = wb.load("robots", "ur5")


@pytest.fixture(scope="module")
def plan():
    return poses.choose(UR5)


@pytest.fixture(scope="module")
def healthy(plan):
    """Seven checks of a robot that does not change."""
    robot = MonthlyRobot(UR5, plan, 7)
    return [health.taken(robot.recording(m), UR5, plan) for m in range(7)]


@pytest.fixture(scope="module")
def kept(plan, tmp_path_factory):
    """A folder with a history of three checks."""
    folder = tmp_path_factory.mktemp("kept")
    for month in range(3):
        checked(folder, MonthlyRobot(UR5, wb.check_plan(UR5, folder), 7), month)
    return folder


@pytest.fixture
def folder(kept, tmp_path):
    """A copy of it."""
    return shutil.copytree(kept, tmp_path / "cell")


def checked(folder, robot, month, **stated):
    return wb.check(UR5, folder, robot.recording(month), **stated)


def rows(folder):
    return pq.read_table(folder / history.FILE)


def rewritten(folder, table):
    pq.write_table(table, folder / history.FILE)


# ---- poses ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["ur5", "medrue"])
def test_a_check_has_few_poses_and_is_short(name):
    robot = wb.load("robots", name)
    q = poses.choose(robot).q
    assert len(q) <= 12 and np.array_equal(q[0], q[-1])
    moves = sum(duration(robot, a, b, 0.25) for a, b in zip([robot.home, *q[:-1]], q, strict=True))
    assert poses.seconds(moves, len(q), poses.SAMPLES, poses.RATE_HZ) <= 180.0


def test_a_long_check_is_refused():
    assert poses.seconds(100.0, 12, 200, 100.0) == pytest.approx(100.0 + 12 * 3.5)
    with pytest.raises(PlanError, match="would take 181 s: 139 s of moves and 12 poses of 2.0 s"):
        poses.seconds(139.0, 12, 200, 100.0)


def test_the_poses_show_changes_better_than_random_ones(plan):
    """The least precise quantity of chosen poses against that of 20 random plans."""

    def worst(q):
        robot = MonthlyRobot(UR5, wb.Plan.of("ur5", q), 1)
        basis = Basis(UR5, [health.taken(robot.recording(0), UR5, robot.plan)])
        std = np.sqrt(np.diagonal(basis.covariance))
        typical = np.array([1.0] * 3 + [0.05] * 3 + [0.03] + [2e-3] * 3 + [0.009] * 5 + [0.01] * 2)
        return (std / typical).max()

    rng = np.random.default_rng(0)
    assert worst(plan.q) < min(worst(UR5.sample(12, rng)) for _ in range(20))


def test_the_plan_is_chosen_once(folder):
    before = (folder / health.PLAN).read_bytes()
    assert np.array_equal(wb.check_plan(UR5, folder).q, wb.Plan.read(folder / health.PLAN).q)
    assert (folder / health.PLAN).read_bytes() == before
    with pytest.raises(HistoryError, match=r"plan.parquet: is of robot 'ur5', not 'medrue'"):
        wb.check_plan(wb.load("robots", "medrue"), folder)


# ---- numbers ----------------------------------------------------------------------------------


def test_values_are_those_of_the_simulation(plan, tmp_path):
    """MuJoCo records, with a known load, tilt and bias."""
    truth = {"tool.mass": 1.42, "tool.cog.x": 0.007, "base.tilt.x": 1e-3, "base.tilt.y": -2e-3,
             "sensor.bias.fx": 1.0, "sensor.bias.tz": 0.02}  # fmt: skip
    with wb.SimDriver(wb.SimOptions("ur5", parameters=truth, seed=3)) as link:
        wb.record(link, plan, tmp_path / "r.parquet", samples=200, revisit=False)
    recording = health.stated(
        wb.Recording.read(tmp_path / "r.parquet"), {"time": "2026-01-01T00:00:00Z"}
    )
    basis = Basis(UR5, [health.taken(recording, UR5, plan)])
    std = np.hypot(np.sqrt(np.diagonal(basis.covariance)), basis.scatter(True))
    stated = UR5.parameters.mapping(UR5.parameters.nominal) | truth
    for name, value, s in zip(QUANTITIES, basis.values[0], std, strict=True):
        if name.startswith(("tool", "base", "mount", "span")):
            assert value == pytest.approx(stated.get(name, 0.0), abs=5 * s), name
        else:
            assert value == pytest.approx(truth.get(name, 0.0), abs=5 * s), name


def test_a_step_is_measured(plan):
    """A lighter tool by look-alikes: size and interval."""
    robot = MonthlyRobot(UR5, plan, 11, fault="tool.mass", begins=6)
    checks = [health.taken(robot.recording(m), UR5, plan) for m in range(8)]
    step = trends.Trends(Basis(UR5, checks)).step(6, list(QUANTITIES).index("tool.mass"))
    item, amount = robot.cause
    (size,) = item.values.values()
    assert step.interval95[0] < size * amount < step.interval95[1]


def by_hand(found, begin, j, walk):
    """Size, standard error and log evidence of a step by generalised least squares."""
    n, unit = found.n, found.expected[j]
    months = 12.0 * (found.years - found.years[0])
    covariance = np.eye(n) + walk * np.minimum(months[:, None], months)
    x = np.column_stack([np.arange(n) >= begin, np.ones(n), found.nuisance[:, 0]]).astype(float)
    prior = np.diag([0.0, 0.0, (unit / found.basis.per_kelvin[j]) ** 2])
    inverse = np.linalg.inv(x.T @ np.linalg.solve(covariance, x) + prior)
    y = found.basis.changes[:, j] / unit
    beta = inverse @ x.T @ np.linalg.solve(covariance, y)
    left = y - x @ beta
    rest = trends.PRIOR + left @ np.linalg.solve(covariance, left) + beta @ prior @ beta
    freedom = trends.PRIOR + n - 2
    told = 0.5 * (np.linalg.slogdet(inverse)[1] - np.linalg.slogdet(covariance)[1])
    return beta[0], np.sqrt(rest / freedom * inverse[0, 0]), told - 0.5 * freedom * np.log(rest)


def test_the_step_is_the_mean_of_regressions_by_hand(healthy):
    """Over walks of all speeds, each weighed by its evidence."""
    found, j = trends.Trends(Basis(UR5, healthy)), 6
    sizes, std, logs = map(
        np.array, zip(*(by_hand(found, 5, j, r) for r in trends.WALKS), strict=True)
    )
    share = np.array([0.5, 0.2, 0.2, 0.1]) * np.exp(logs - logs.max())
    share /= share.sum()
    step = found.step(5, j)
    size = share @ sizes
    assert step.size == pytest.approx(size * found.expected[j])
    spread = np.sqrt(share @ (std**2 + (sizes - size) ** 2))
    assert step.std == pytest.approx(spread * found.expected[j])
    assert step.p == pytest.approx(share @ (2 * stats.t.sf(np.abs(sizes) / std, step.freedom)))
    assert step.freedom == trends.PRIOR + 5


def test_a_zero_that_walks_for_months_is_no_step(plan):
    """0.3 noises of a row a month, which five years add up to 2.3."""
    robot, walk, rng = MonthlyRobot(UR5, plan, 41), np.zeros(6), np.random.default_rng(5)
    std, checks = wb.load("sensors", UR5.sensor).noise.row_std, []
    for month in range(24):
        walk = walk + rng.normal(0.0, 0.3, 6) * std
        new = health.taken(robot.recording(month), UR5, plan)
        checks.append(replace(new, wrench=new.wrench + walk))
    found = [trends.Trends(Basis(UR5, checks[:n])) for n in range(2, 25)]
    assert not [t for x in found for t in x.tests() if t.alarm]
    without_walk = found[-1]._shares(23)[0, :6]
    assert np.median(without_walk) < 0.05 and (without_walk < 0.5).all()


def test_levels_spend_one_percent_a_year(healthy):
    found = trends.Trends(Basis(UR5, healthy))
    whole = sum(t.level for t in found.tests())
    months = (healthy[-1].time - healthy[-2].time).total_seconds() / trends.YEAR_S
    spent = sum(share for m, share in trends.SINCE.items() if m < 7)
    assert whole == pytest.approx(0.01 * months * spent)
    weekly = [replace(c, time=healthy[0].time + timedelta(days=7 * k)) for k, c in
              enumerate(healthy)]  # fmt: skip
    assert trends.Trends(Basis(UR5, weekly)).budget() == pytest.approx(0.01 * 7 / 365.25)


def test_p_values_are_uniform_under_the_prior(healthy):
    """Scatter, walk and temperature law drawn as assumed: 5 % of p values are below 0.05."""
    basis, rng, below, tries = Basis(UR5, healthy), np.random.default_rng(1), 0, 2000
    law = trends.Trends(basis)
    assert law.warm
    for _ in range(tries):
        scale = law.expected * np.sqrt(trends.PRIOR / rng.chisquare(trends.PRIOR, 17))
        slope = basis.per_kelvin / law.expected * scale * rng.standard_normal(17)
        root = np.linalg.inv(trends.Trends(basis)._roots[rng.choice(4, p=trends._WALK_PRIOR)])
        basis.__dict__["changes"] = root @ (scale * rng.standard_normal((7, 17)))
        basis.__dict__["changes"] += law.nuisance * slope
        below += trends.Trends(basis).step(6, 6).p < 0.05
    assert below / tries == pytest.approx(0.05, abs=4 * np.sqrt(0.05 * 0.95 / tries))


# ---- verdicts ---------------------------------------------------------------------------------


def test_first_checks_cannot_tell_and_later_ones_are_healthy(healthy):
    verdicts = [health.judge(UR5, healthy[: k + 1]).verdict for k in range(7)]
    assert verdicts == ["cannot tell"] * 3 + ["healthy"] * 4
    first = health.judge(UR5, healthy[:1])
    assert first.tests == () and "check 1 since the first check" in first.headline


@pytest.mark.parametrize(
    "fault", ["sensor.gain", "base.tilt", "tool.mass", "tool.cog", "mount.rotation"]
)
def test_a_change_is_found_and_named(plan, fault):
    robot = MonthlyRobot(UR5, plan, 21, fault=fault, begins=5, gap=4.0)
    checks = [health.taken(robot.recording(m), UR5, plan) for m in range(6)]
    found = health.judge(UR5, checks)
    assert found.verdict == "changed" and found.begin == 5
    assert found.causes[0].effect == fault and found.causes[0].probability > 0.5
    assert sum(found.chances.values()) == pytest.approx(1.0, abs=0.02)
    assert fault in found.headline and found.moved


def test_a_change_by_no_effect_of_the_library_is_unknown(plan):
    robot = MonthlyRobot(UR5, plan, 22, fault="cable.pull", begins=5)
    checks = [health.taken(robot.recording(m), UR5, plan) for m in range(6)]
    found = health.judge(UR5, checks)
    assert found.verdict == "changed" and not found.causes
    assert "no effect of the library explains it" in found.headline
    assert found.chances["unknown"] > 0.5


def test_a_change_stays_until_a_new_baseline(plan):
    robot = MonthlyRobot(UR5, plan, 23, fault="tool.cog", begins=5)
    checks = []
    for month in range(8):
        new = health.taken(robot.recording(month), UR5, plan)
        checks.append(replace(new, verdict=health.judge(UR5, [*checks, new]).verdict))
    assert [c.verdict for c in checks[5:]] == ["changed"] * 3
    renewed = [*checks[:7], replace(checks[7], baseline="tool replaced")]
    found = health.judge(UR5, renewed)
    assert found.verdict == "cannot tell" and "since tool replaced" in found.headline


def test_a_recorded_temperature_makes_zeros_sharper(plan):
    """The same robot with and without the column."""
    visible = []
    for warm in (True, False):
        robot = MonthlyRobot(UR5, plan, 31, warm=warm)
        checks = [health.taken(robot.recording(m), UR5, plan) for m in range(8)]
        visible.append(trends.Trends(Basis(UR5, checks)).visible()[:6])
    assert (visible[0] < visible[1]).all()


# ---- history ----------------------------------------------------------------------------------


def test_a_history_reads_as_it_was_written(folder):
    checks = history.read(folder)
    assert [c.verdict for c in checks] == ["cannot tell"] * 3
    again = MonthlyRobot(UR5, wb.check_plan(UR5, folder), 7)
    for month, found in enumerate(checks):
        new = health.taken(again.recording(month), UR5, again.plan)
        assert found.wrench == pytest.approx(new.wrench, abs=0) and found.time == new.time
        assert found.covariance == pytest.approx(new.covariance, abs=0)
        assert (folder / found.recording).exists()
    basis = Basis(UR5, checks)
    assert checks[2].values["tool.mass"] == pytest.approx(basis.values[2, 6], rel=1e-6)
    assert np.sqrt(checks[2].correlated[6, 6]) == checks[2].values["tool.mass.std"]
    assert checks[2].values["misfit"] == pytest.approx(basis.misfit[2], rel=0.1)


def test_a_write_that_fails_leaves_the_old_history(folder, monkeypatch):
    before = (folder / history.FILE).read_bytes()

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pyarrow.parquet.write_table", full)
    robot = MonthlyRobot(UR5, wb.check_plan(UR5, folder), 7)
    with pytest.raises(OSError, match="No space left"):
        checked(folder, robot, 3)
    assert (folder / history.FILE).read_bytes() == before
    monkeypatch.undo()
    assert checked(folder, robot, 3).verdict == "healthy" and len(history.read(folder)) == 4


def cut(folder):
    path = folder / history.FILE
    path.write_bytes(path.read_bytes()[:-1000])
    return r"history.parquet: not a complete Parquet file .*; give --rebuild"


def doubled(folder):
    rewritten(folder, pa.concat_tables([rows(folder), rows(folder).slice(2, 1)]))
    return r"row 3 \(2020-03-1\d .*\) holds the readings of row 2 .*one check is there twice; give"


def other_robot(folder):
    table = rows(folder)
    at = table.schema.get_field_index("robot_digest")
    rewritten(folder, table.set_column(at, "robot_digest", pa.array(["0" * 16, *["1" * 16] * 2])))
    return r"row 1 is of ur5 with ati-gamma \(1111111111111111\), row 0 of ur5 .*folder of its own"


def out_of_order(folder):
    table = rows(folder)
    rewritten(folder, table.take([1, 0, 2]))
    return r"row 1 is of 2020-01-1\d .*, not after row 0 \(2020-02-1\d.*: the rows are out of order"


def not_a_number(folder):
    table = rows(folder)
    at = table.schema.get_field_index("hold03.fz")
    values = table["hold03.fz"].to_numpy().copy()
    values[1] = np.nan
    rewritten(folder, table.set_column(at, "hold03.fz", pa.array(values)))
    return r"column 'hold03.fz', row 1: .*nan.* is no finite number"


def without_column(folder):
    rewritten(folder, rows(folder).drop_columns(["hold03.fz"]))
    return r"column 'hold03.fz' is missing: give --rebuild"


@pytest.mark.parametrize(
    "damage", [cut, doubled, other_robot, out_of_order, not_a_number, without_column]
)
def test_a_damaged_history_is_refused_and_can_be_made_again(folder, damage, capfd):
    good = history.read(folder)
    message = damage(folder)
    damaged = (folder / history.FILE).read_bytes()
    with pytest.raises(HistoryError, match=message):
        history.read(folder)
    code = main(["check", "ur5", "--history", str(folder)])
    told = capfd.readouterr()
    assert code == 1 and told.err.count("\n") == 1 and told.out == ""
    assert (folder / history.FILE).read_bytes() == damaged
    assert main(["check", "ur5", "--history", str(folder), "--rebuild"]) == 4
    assert [c.time for c in history.read(folder)] == [c.time for c in good]
    assert (folder / (history.FILE + "~")).read_bytes() == damaged


def test_the_same_recording_twice_is_refused(folder):
    robot = MonthlyRobot(UR5, wb.check_plan(UR5, folder), 7)
    with pytest.raises(
        HistoryError, match="holds the readings of row 1 .*: it was checked already"
    ):
        checked(folder, robot, 1, time=datetime(2021, 1, 1, tzinfo=UTC))
    assert len(history.read(folder)) == 3 and len(list((folder / "recordings").iterdir())) == 3


def test_a_clock_that_was_set_back_is_refused(folder):
    robot = MonthlyRobot(UR5, wb.check_plan(UR5, folder), 7)
    with pytest.raises(
        HistoryError, match=r"the new check is of 2020-02-01 .*, not after row 2 .*"
    ):
        checked(folder, robot, 3, time=datetime(2020, 2, 1, tzinfo=UTC))
    checks = history.read(folder)
    with pytest.raises(
        HistoryError, match=r"row 2 is of 2020-03-.*clock shows 2020-02-01 .*set back"
    ):
        history.in_time(folder, checks, checks[-1].time, datetime(2020, 2, 1, tzinfo=UTC))
    with pytest.raises(HistoryError, match=r"the new check is of 2999.*set the clock, or state"):
        checked(folder, robot, 3, time=datetime(2999, 1, 1, tzinfo=UTC))
    assert len(history.read(folder)) == 3


def test_recordings_of_other_poses_or_robots_are_refused(folder, plan):
    moved = wb.Plan.of("ur5", plan.q + np.where(np.arange(12) == 4, 0.1, 0.0)[:, None])
    with pytest.raises(RecordingError, match=r"pose 4 is not that of .*plan.parquet: record that"):
        checked(folder, MonthlyRobot(UR5, moved, 7), 5)
    short = wb.Plan.of("ur5", plan.q[:8])
    with pytest.raises(RecordingError, match="holds 8 poses; pose 8 is not that of"):
        checked(folder, MonthlyRobot(UR5, short, 7), 5)
    recording = MonthlyRobot(UR5, plan, 7).recording(5)
    other = replace(recording, metadata=replace(recording.metadata, robot="medrue"))
    with pytest.raises(RecordingError, match="is of medrue .static.; a check needs ur5"):
        wb.check(UR5, folder, other)
    bare = replace(recording, metadata=replace(recording.metadata, extra={}))
    with pytest.raises(HistoryError, match="states no time; give --time"):
        wb.check(UR5, folder, bare)
    assert len(history.read(folder)) == 3


def test_rebuilding_leaves_out_what_does_not_fit(folder):
    (folder / "recordings" / "20200214T000000Z.parquet").write_bytes(b"PAR1 cut")
    with pytest.warns(
        WrenchbedWarning, match="20200214T000000Z.parquet: left out: .*not a complete"
    ):
        found = health.rebuild(UR5, folder, datetime.now(UTC))
    assert found.verdict == "cannot tell" and len(history.read(folder)) == 3


# ---- command line and page --------------------------------------------------------------------


def test_the_command_checks_the_simulated_robot(tmp_path, capfd):
    folder = str(tmp_path / "cell")

    def run(month, *more):
        code = main(["check", "ur5", "--history", folder, "--time", f"2026-{month:02}-01T06:00:00Z",
                     "--samples", "50", "--json", *more])  # fmt: skip
        told = capfd.readouterr()
        return code, json.loads(told.out)

    assert main(["check", "ur5", "--history", folder, "--prepare"]) == 0
    assert "12 poses take 79 s at 50% of top speed" in capfd.readouterr().out
    assert not (tmp_path / "cell" / history.FILE).exists()
    codes = [run(month, "--temperature", "21")[0] for month in range(1, 5)]
    assert codes == [4, 4, 4, 0]
    code, told = run(5, "--temperature", "21", "--effect", "base.tilt:x=0.004")
    assert code == 3 and told["verdict"] == "changed" and told["checks"] == 5
    change = told["change"]
    assert change["before"].startswith("2026-05-01") and change["after"].startswith("2026-04-01")
    assert change["causes"][0]["effect"] == "base.tilt"
    x = change["causes"][0]["parameters"]["x"]
    assert x["value"] == pytest.approx(0.004, abs=4 * x["std"])
    assert told["quantities"]["base.tilt.x"]["value"] == pytest.approx(0.004, abs=2e-4)
    assert told["temperature"] == 21.0
    code, told = run(6, "--temperature", "21", "--new-baseline", "levelled the base")
    assert code == 4 and told["since"].startswith("2026-06-01") and told["change"] is None


def test_a_recording_of_the_plan_is_checked(folder, plan, tmp_path, capfd):
    robot = MonthlyRobot(UR5, wb.check_plan(UR5, folder), 7)
    robot.recording(3).write(tmp_path / "april.parquet")
    words = ["check", "ur5", "--history", str(folder), "--recording"]
    assert main([*words, str(tmp_path / "april.parquet")]) == 0
    assert "healthy: no change in 4 checks since 2020-01-1" in capfd.readouterr().out
    assert main([*words, str(tmp_path / "april.parquet")]) == 1
    assert "it was checked already" in capfd.readouterr().err
    assert main(["check", "ur5", "--history", str(folder), "--samples", "2000"]) == 1
    assert "would take" in capfd.readouterr().err


def test_the_page_says_what_the_verdict_says(plan):
    robot = MonthlyRobot(UR5, plan, 23, fault="tool.cog", begins=5)
    checks = [health.taken(robot.recording(m), UR5, plan) for m in range(6)]
    found = health.judge(UR5, checks)
    told = page(found, "wrenchbed check ur5 --history cell").html()
    assert found.headline in told and "What changed" in told
    assert told.index(found.headline) < told.index("All checks")
    assert told.count("<svg") >= 3 and "change" in told
    document = page(health.judge(UR5, checks[:5]))
    table = document.sections[-1].parts[0]
    assert [row[0][:7] for row in table.rows][-1] == f"{checks[0].time:%Y-%m}"
    assert len(table.rows) == 5 and document.sections[0].title == "This check"


def test_a_page_of_one_check_is_drawn(healthy):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert "cannot tell yet" in page(health.judge(UR5, healthy[:1])).html()


# ---- study ------------------------------------------------------------------------------------


@pytest.mark.study
@pytest.mark.parametrize("warm", [True, False])
def test_false_alarms_are_rare(plan, warm):
    """Ten healthy robots for five years; 1 % a robot-year allow 0.5 alarms."""
    alarms = 0
    for seed in range(9000, 9010):
        robot, checks = MonthlyRobot(UR5, plan, seed, warm=warm), []
        for month in range(60):
            new = health.taken(robot.recording(month), UR5, plan)
            verdict = health.judge(UR5, [*checks, new]).verdict
            checks.append(replace(new, verdict=verdict))
            if verdict == "changed":
                alarms += 1
                break
    assert alarms <= 2


@pytest.mark.study
def test_most_changes_are_found_within_two_checks_and_named(plan):
    found, faults = 0, ("sensor.bias", "sensor.gain", "base.tilt", "tool.mass", "tool.cog",
                        "mount.rotation", "joint.offset", "joint.compliance")  # fmt: skip
    named = 0
    for k in range(24):
        begins = 4 + 2 * k
        robot = MonthlyRobot(UR5, plan, 9100 + k, fault=faults[k % 8], begins=begins)
        checks = [health.taken(robot.recording(m), UR5, plan) for m in range(begins + 2)]
        judged = [health.judge(UR5, checks[:n]) for n in (begins + 1, begins + 2)]
        hit = next((j for j in judged if j.verdict == "changed"), None)
        found += hit is not None
        named += hit is not None and faults[k % 8] in [c.effect for c in hit.causes]
    assert found >= 0.9 * 24 and named >= 0.85 * 24
