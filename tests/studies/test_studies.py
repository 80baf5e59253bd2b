"""The two papers run again: published and golden numbers recovered on small sizes."""

import json
import re
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest

from wrenchbed.cli import main
from wrenchbed.pages.chart import Axis, Chart, Panel
from wrenchbed.pages.document import Document, Figure, Section, Table, render
from wrenchbed.planning.criteria import INDICES
from wrenchbed.planning.exchange import Pool, exchange
from wrenchbed.simulation.mujoco_wrench import Simulation
from wrenchbed.studies import medrue
from wrenchbed.studies import medrue_identification as identification
from wrenchbed.studies import medrue_setting as published
from wrenchbed.studies.medrue_identification import as_the_paper, weighted
from wrenchbed.studies.medrue_setting import MINI40, PAPER, SAMPLES, PoseDesign, prepare
from wrenchbed.studies.ur5 import SCENARIOS, geometric_mean, trial


@pytest.fixture(scope="module")
def setting():
    return prepare(4000, 0, orientations=10)


@pytest.fixture(scope="module")
def chosen(setting):
    return exchange(Pool(setting.in_table_units), INDICES["O1"], 100, seed=0).chosen


@pytest.fixture(scope="module")
def paper_robot(setting, chosen):
    designs = {k: PoseDesign(k, chosen, 1.0, None) for k in identification.INDICES}
    return identification.paper_robot(setting, designs, seed=0)


def test_table_1_gives_the_printed_position_errors(paper_robot):
    rows = {(r["method"], r["workspace"], r["quantity"]): r for r in paper_robot.printed}
    before, after = (rows[m, "target", "position"] for m in ("before", "printed"))
    printed = {"before": (8.59, 12.37, 1.63), "after": (0.274, 0.329, 0.0178)}
    for row, key in ((before, "before"), (after, "after")):
        evaluated = [1e3 * row[s] for s in ("mean", "max", "std")]
        assert evaluated == pytest.approx(printed[key], rel=5e-3)
    assert 1e3 * after["mean"] == pytest.approx(published.AFTER["mean"], rel=0.03)
    assert 1e3 * before["mean"] == pytest.approx(9.03, rel=0.06)  # from Table 3


def test_without_noise_the_papers_procedure_is_exact_in_five_steps(paper_robot):
    assert paper_robot.exact.steps in (5, 6)
    for errors in paper_robot.errors["exact"].values():
        assert errors.max() < 1e-12  # m


def test_the_bound_follows_from_noise_and_mass(setting, chosen):
    bound = setting.bound(chosen, PAPER.std)
    assert 1.7e-3 < bound < 2.7e-3
    assert setting.bound(chosen, PAPER.std * 2) == pytest.approx(2 * bound)
    theta = setting.model.parameters.vector({"mTool": 0.73})
    heavy = replace(setting, jacobian=setting.model.jacobian(setting.q, theta, setting.columns))
    assert heavy.bound(chosen, PAPER.std) == pytest.approx(bound / 2, rel=1e-6)
    assert bound / setting.bound(chosen, PAPER.std * np.sqrt(SAMPLES)) == pytest.approx(0.1)


def test_weighted_identification_is_efficient_and_unweighted_is_not(setting, chosen):
    theta = identification.of_table_1(setting, published.ACTUAL)
    q = setting.q[chosen]
    exact = Simulation(setting.robot, theta[: len(setting.robot.parameters)]).wrench(q)
    rng = np.random.default_rng(0)
    covariance = setting.covariance(chosen, MINI40.std)
    columns = list(setting.columns)
    distances, plain, best = [], [], []
    for _ in range(20):
        wrench = exact + rng.standard_normal(exact.shape) * MINI40.std
        found = weighted(setting, q, wrench, MINI40.std, theta).theta
        off = found[columns] - theta[columns]
        distances.append(off @ np.linalg.solve(covariance, off))
        best.append(setting.goal.errors(off))
        unweighted = as_the_paper(setting, q, wrench, 1e-6).theta
        plain.append(setting.goal.errors(unweighted[columns] - theta[columns]))
    assert np.mean(distances) == pytest.approx(27.0, abs=4 * np.sqrt(2 * 27 / 20))
    assert np.sqrt(np.mean(np.square(plain))) > 1.5 * np.sqrt(np.mean(np.square(best)))


def test_cells_are_shown_with_sense_and_pages_escape():
    assert [render(x) for x in ("a", 40_000, 0.0, np.nan, 2.0312, 1.5e-9)] == [
        "a", "40,000", "0", "–", "2.031", "1.5·10⁻⁹",
    ]  # fmt: skip
    table = Table.of("T <1>", ("a|b", "n"), [("x < y", 1)], "note & more")
    figure = Figure("f", "F <2>", Chart("", "", (Panel(Axis("x"), Axis("y")),)))
    page = Document("P", "lead", (Section("S", "text", (table, figure)),))
    assert r"a\|b" in page.markdown()
    html = page.html()
    assert "x &lt; y" in html
    assert re.search(r"<svg[^>]*><title>F &lt;2&gt;</title>", html)
    assert "T &lt;1&gt;" in html
    with pytest.raises(ValueError, match="must have 2 cells"):
        Table.of("T", ("a", "b"), [("only one",)])


@pytest.mark.study
def test_the_medrue_study_runs_from_pool_to_page(tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(medrue, "POOL", 2000)
    out = tmp_path / "study"
    run = ["study", "medrue", "--quick", "--robots", "2", "--out", str(out), "--json"]
    assert main(run) == 0
    result = json.loads(capfd.readouterr().out)
    assert result["rank"] == 27
    assert len(result["redundancies"]) == 8
    assert 1.5 < result["bound_mm"] < 3.5
    assert result["published_mm"] == pytest.approx(0.2775, abs=1e-4)
    assert max(result["noise_free_mm"].values()) < 1e-9
    text = (out / "medrue.md").read_text(encoding="utf-8")
    titles = [f"Table {n}" for n in (1, 4, 5, 6)] + [f"Figure {n}" for n in (4, 6, 7, 8)]
    for title in (*titles, "Tables 2 and 3", "The headline and the noise"):
        assert title in text, title
    for figure in ("figure4", "figure6", "figure7", "figure8"):
        assert (out / f"{figure}.svg").read_text(encoding="utf-8").startswith("<svg")
    assert json.loads((out / "medrue.json").read_text(encoding="utf-8")) == result
    assert pq.read_table(out / "robots.parquet").num_rows > 100
    html = (out / "medrue.html").read_text(encoding="utf-8")
    html = re.sub(r"<script>.*?</script>", "", html, flags=re.DOTALL)  # a licence's address
    assert not re.search(r"(src|href)=\"(https?:)?//", html)


def overall(trial, method):
    """Geometric means of force and torque over all directions."""
    parts = np.split(trial.residual[method], 2, axis=1)
    return [geometric_mean(np.linalg.norm(part, axis=1)) for part in parts]


@pytest.fixture(scope="module")
def as_assumed():
    return trial(SCENARIOS[0], seed=4)


def test_the_joint_fit_reaches_the_floor_and_others_leave_what_they_ignore(as_assumed):
    floor = overall(as_assumed, "exact model")
    for method in ("Method 1", "joint fit"):
        found = overall(as_assumed, method)
        assert found[0] < 1.5 * floor[0]
        assert found[1] < 1.5 * floor[1]
    # Method 2 ignores the bias and the sensor's own weight.
    scene = as_assumed.scene
    truth = scene.model.parameters.mapping(scene.theta)
    bias = np.array([truth[f"sensor.bias.f{a}"] for a in "xyz"])
    weight = 9.81 * truth["sensor.mass"]
    remaining = np.linalg.norm(as_assumed.residual["Method 2"][:, :3] - bias, axis=1)
    assert np.abs(remaining - weight).max() < 0.05
    assert np.linalg.norm(as_assumed.residual["Method 3"][:, :3], axis=1).max() > 10.0
    assert np.linalg.norm(as_assumed.residual["Method 1"][:, :3], axis=1).max() < 0.05


def test_models_and_masses_that_are_wrong_show():
    wrong = trial(next(s for s in SCENARIOS if "dq5" in s.true), seed=4)
    assert overall(wrong, "joint fit")[0] > 3 * overall(wrong, "exact model")[0]
    wrong = trial(next(s for s in SCENARIOS if s.stated_mass != 1.0 and not s.cold), seed=4)
    floor = overall(wrong, "exact model")[0]
    assert overall(wrong, "Method 1")[0] > 20 * floor
    assert overall(wrong, "joint fit")[0] < 1.5 * floor
    mass = wrong.fit["tool.mass"]
    assert abs(mass.value - 1.35) < 4 * mass.std


@pytest.mark.study
def test_the_ur5_study_runs(tmp_path, capfd):
    out = tmp_path / "ur5"
    assert main(["study", "ur5", "--robots", "2", "--quick", "--out", str(out), "--json"]) == 0
    result = json.loads(capfd.readouterr().out)
    assert {"rank", "redundancies", "bound_mm", "force", "scenarios"} <= set(result)
    assert set(result["force"]) == {"right", "up", "backward", "down", "left"}
    text = (out / "ur5.md").read_text(encoding="utf-8")
    for n in range(2, 7):
        assert f"Table {n}: tool" in text
    for n in range(8, 18):
        assert (out / f"figure{n}.svg").exists()
