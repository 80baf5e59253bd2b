"""Position errors of the tool: Jacobians, bounds, touches and the plan that mixes them."""

import numpy as np
import pyarrow.parquet as pq
import pytest

import wrenchbed as wb
from simulated import as_driven, driven, static
from wrenchbed.calibration.position_error import Goal, statistics, tip_jacobian
from wrenchbed.data.recording import Recording
from wrenchbed.errors import CalibrationError, DriverError, NotFoundError, PlanError, WrenchbedError
from wrenchbed.robots.medrue import inverse_kinematics

MEDRUE = wb.load("robots", "medrue")
MODEL = wb.Model.of(MEDRUE)
OWN = len(MEDRUE.parameters)
TOUCHES = 15
FREE = wb.Options(free=("candidates", "sensor.bias"), prior=True)
CANDIDATES = MODEL.parameters.select(MEDRUE.candidates)


def wrong(seed: int, names=("sensor.bias",)) -> dict[str, float]:
    """A robot with every candidate and the bias somewhere within its tolerance."""
    rng = np.random.default_rng(seed)
    items = [MODEL.parameters[c] for c in MODEL.parameters.select([*MEDRUE.candidates, *names])]
    return {p.name: p.nominal + rng.uniform(-1, 1) * p.tolerance for p in items}


def test_the_tips_jacobian_is_its_derivative():
    q = MEDRUE.sample(5, np.random.default_rng(0))
    theta = MODEL.parameters.vector(wrong(1))
    jacobian = tip_jacobian(MEDRUE, q, theta, CANDIDATES)
    for k in (0, 7, 17, 21, 30, 40):
        step = np.zeros(len(theta))
        step[CANDIDATES[k]] = 1e-6
        ahead, behind = (MEDRUE.tool_pose(q, (theta + s)[:OWN])[1] for s in (step, -step))
        assert jacobian[:, :, k] == pytest.approx((ahead - behind) / 2e-6, abs=1e-7)
    bias = MODEL.parameters.select(["sensor.bias"])
    assert not tip_jacobian(MEDRUE, q, theta, bias).any()


def test_rms_and_quantile_agree_with_draws():
    rng = np.random.default_rng(3)
    goal = Goal(rng.normal(size=(40, 3, 5)))
    half = rng.normal(size=(5, 5)) * 0.1
    covariance = half @ half.T
    draws = rng.multivariate_normal(np.zeros(5), covariance, 20_000)
    rms = statistics(goal.errors(draws))[:, 3]
    assert np.sqrt(np.mean(rms**2)) == pytest.approx(goal.rms(covariance), rel=0.02)
    assert np.quantile(rms, 0.95) == pytest.approx(goal.quantile(covariance, 0.95), rel=0.04)


def test_what_no_tip_plan_or_touch_can_reach_is_said(tmp_path):
    ur5 = wb.load("robots", "ur5")
    q = ur5.home[None]
    with pytest.raises(NotFoundError, match="'ur5' has no tool tip"):
        ur5.tool_pose(q, ur5.parameters.nominal)
    with pytest.raises(NotFoundError, match="no tool tip and target workspace"):
        wb.reach(ur5, 1e-3)
    with pytest.raises(PlanError, match="together reach .* mm, not 1e-06 mm: touch more"):
        wb.reach(MEDRUE, 1e-9, pool=100, touch_std=1e-2, points=np.array([[0.4, 0.4, -0.2]]))
    with pytest.raises(PlanError, match="must be above 0"):
        wb.reach(MEDRUE, 0.0)
    with pytest.raises(WrenchbedError, match="none of the 1 points to touch is in reach"):
        inverse_kinematics.touch_poses(MEDRUE, np.array([[5.0, 0.0, 0.0]]), seed=0)
    plan = wb.Plan.of("medrue", MEDRUE.home[None], points=np.array([[3.0, 0.0, 0.0]]))
    with (
        wb.SimDriver(wb.SimOptions("medrue")) as driver,
        pytest.raises(DriverError, match="cannot reach"),
    ):
        wb.record(driver, plan, tmp_path / "t.parquet")
    path = tmp_path / "p.parquet"
    wb.Plan.of("medrue", MEDRUE.home[None], points=np.zeros((1, 3))).write(path)
    table = pq.read_table(path)
    pq.write_table(table.drop_columns(["pz"]), path)
    with pytest.raises(PlanError, match="need all of px py pz"):
        wb.Plan.read(path)


def test_the_papers_workspaces():
    pool = inverse_kinematics.pool(MEDRUE, 600, seed=1, orientations=50)
    assert pool.shape == (600, 6)
    assert not MEDRUE.infeasible(pool, MEDRUE.parameters.nominal)
    rotation, tip = MEDRUE.tool_pose(pool, MEDRUE.parameters.nominal)
    assert sorted({round(float(z), 6) for z in tip[:, 2]}) == [-0.25, -0.10, 0.05]
    assert ((tip[:, :2] > [-1e-9, 0.2 - 1e-9]) & (tip[:, :2] < [0.8, 0.65])).all()
    assert len(np.unique(np.round(tip, 6), axis=0)) == 12
    down = -rotation[:, 2, 2]
    assert down.min() > np.cos(np.deg2rad(60 + 30)) - 1e-9
    target = inverse_kinematics.target(MEDRUE)
    assert target.shape == (336, 6)
    _, points = MEDRUE.tool_pose(target, MEDRUE.parameters.nominal)
    assert points == pytest.approx(inverse_kinematics.target_points(), abs=1e-12)


@pytest.fixture(scope="module")
def touched(tmp_path_factory):
    folder, truth = tmp_path_factory.mktemp("touched"), wrong(11)
    sets = MEDRUE.goal_sets(100, None, seed=0)
    pick = np.random.default_rng(0).permutation(len(sets.touch))[:TOUCHES]
    plan = wb.Plan.of("medrue", sets.touch[pick], points=sets.points[pick])
    plan.write(folder / "plan.parquet")
    plan = wb.Plan.read(folder / "plan.parquet")
    touched = driven(plan, folder / "touch.parquet", 3, parameters=truth, seed=5)
    std = np.array(wb.load("sensors", "ati-gamma").noise.row_std)
    gravity = as_driven(static("medrue", truth, poses=20, samples=50, noise=std, seed=5))
    return plan, truth, gravity, wb.Touches.of(touched)


def rms_error(fit, truth) -> float:
    """Of the tool's position over the target workspace, by MuJoCo [m]."""
    target = inverse_kinematics.target(MEDRUE)
    true, found = (MODEL.parameters.vector(dict(x))[:OWN] for x in (truth, fit.theta))
    error = MEDRUE.tool_pose(target, found)[1] - wb.Simulation(MEDRUE, true).tip(target)
    return float(np.sqrt((error**2).sum(axis=1).mean()))


def test_touches_bring_the_tool_into_reach(touched):
    _, truth, gravity, touches = touched
    alone, both = wb.calibrate(gravity, FREE), wb.calibrate(gravity, FREE, touches)
    assert both.target_rms < 1e-4 < 2e-3 < alone.target_rms
    assert 0.3 < rms_error(both, truth) / both.target_rms < 3.0
    with pytest.raises(CalibrationError, match="Free sensor.bias too"):
        wb.calibrate(gravity)
    assert wb.calibrate(gravity, wb.Options(force=True)).target_rms is None
    assert rms_error(alone, truth) > 2e-3
    assert rms_error(both, truth) < 1.2e-4
    assert both.observability.rank > alone.observability.rank
    off = [(p.value - truth[p.name]) / p.std for p in both.identified if p.name[0] in "xyz"]
    assert np.abs(off).max() < 4.0
    assert (both.touches.count, both.touches.doubtful) == (TOUCHES, False)
    assert both.to_json()["touches"]["p_value"] > 0.001


def test_a_wrong_touch_is_named_and_no_accuracy_is_promised(touched):
    *_, gravity, good = touched
    points = good.points.copy()
    points[7, 0] += 2e-3
    wrong = wb.calibrate(gravity, FREE, wb.Touches(good.q, points, good.std))
    assert wrong.touches.doubtful
    assert wrong.touches.worst == 7
    assert "touch 7 (counted from 0) lies" in wrong.status
    assert wrong.target_rms is None


@pytest.fixture(scope="module")
def mix():
    return wb.reach(MEDRUE, 3e-4, pool=800)


@pytest.mark.slow
@pytest.mark.parametrize("number", [0, 1])
def test_robots_that_run_the_mix_reach_it(mix, tmp_path, number):
    assert mix.rms < mix.assured <= 3e-4 and len(mix) <= 16
    truth = wrong(100 + number)
    with wb.SimDriver(wb.SimOptions("medrue", parameters=truth, seed=number)) as driver:
        wb.record(driver, mix.gravity, tmp_path / "g.parquet")
        wb.record(driver, mix.touches, tmp_path / "t.parquet", samples=3)
    touches = wb.Touches.of(Recording.read(tmp_path / "t.parquet"))
    fit = wb.calibrate(Recording.read(tmp_path / "g.parquet"), FREE, touches)
    assert rms_error(fit, truth) < 3.3e-4


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x,y,z\n", "0 rows"),
        ("x,y\n1,2\n", "column 'z' is missing"),
        ("x,y,z\n1,2,3\n1,2,a\n", "column 'z', row 1: 'a' is no number"),
        ("x,y,z\n400,300,-200\n", "is it in mm"),
        ("x,y,z\n1,nan,0\n", "column 'y', row 0: the value is missing"),
        (None, "there is no such file"),
    ],
)
def test_points_come_from_csv_with_clear_errors(tmp_path, text, words):
    path = tmp_path / "points.csv"
    path.write_text("x,y,z\n0.4,0.3,-0.2\n0.5,0.3,-0.2\n")
    assert wb.read_points(path) == pytest.approx(np.array([[0.4, 0.3, -0.2], [0.5, 0.3, -0.2]]))
    path.unlink() if text is None else path.write_text(text)
    with pytest.raises(PlanError, match=words):
        wb.read_points(path)
