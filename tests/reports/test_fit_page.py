"""The page of a fit: the numbers of fit.json, the words of the terminal, each pose's residual."""

import json
import re
from dataclasses import replace
from html import unescape

import numpy as np
import pytest
from test_report import words

import wrenchbed as wb
from simulated import driven
from wrenchbed.cli import main
from wrenchbed.pages.numbers import HUMAN
from wrenchbed.reports.fit_page import fit_page


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A UR5 whose joint 2 is compliant: a fit leaves more than noise."""
    path = tmp_path_factory.mktemp("fit") / "rec.parquet"
    effects = ("joint.compliance:joint=2,stiffness=9000",)
    return driven(wb.poses(wb.load("robots", "ur5"), 40, seed=1), path, effects=effects, seed=1)


@pytest.fixture(scope="module")
def fit(recorded):
    return wb.calibrate(recorded)


def charts(page) -> dict:
    return {f.chart.name: f.chart for f in page.figures}


@pytest.mark.slow
def test_the_page_holds_the_numbers_of_the_json(recorded, tmp_path, capsys):
    out, page = tmp_path / "fit.json", tmp_path / "fit.html"
    name = recorded.name
    assert main(["calibrate", name, "--out", str(out), "--report", str(page)]) == 0
    assert f"page → {page}" in capsys.readouterr().out
    told, html = json.loads(out.read_text()), page.read_text()
    rows = dict(re.findall(r"<tr><td>([\w.]+)</td>(.*?)</tr>", html))
    assert set(told["parameters"]) <= set(rows)
    for key, p in told["parameters"].items():
        value, std, unit, interval, _, _ = (
            unescape(c).replace("−", "-") for c in re.findall(r"<td.*?>(.*?)</td>", rows[key])
        )
        shown, factor = HUMAN.get(p["unit"], (p["unit"], 1.0))
        assert unit == shown
        assert float(value) == pytest.approx(factor * p["value"], abs=0.1 * factor * p["std"])
        assert float(std) == pytest.approx(factor * p["std"], rel=0.06)
        low, high = map(float, interval.split(" … "))
        assert high - low == pytest.approx(2 * factor * p["interval95"], rel=0.03)
    data = json.loads(re.search(r'id="charts">(.*?)</script>', html, re.DOTALL)[1])
    matrix = data["correlation"]["panels"][0]["matrix"]
    assert matrix["rows"] == told["correlation"]["names"]
    assert np.allclose(matrix["values"], told["correlation"]["matrix"], atol=1e-5)
    for number in told["residual_rms"].values():
        assert isinstance(number, str) or f"{number:.4f}" in html or f"{number:.6f}" in html
    text = words(html)
    assert all(r["sentence"] in text for r in told["redundancies"])
    assert told["status"] in text
    assert f"wrenchbed calibrate {name} --out {out} --report {page}" in text


@pytest.mark.slow
def test_what_is_drawn_of_each_pose_is_what_the_fit_leaves(fit, recorded):
    told = charts(fit_page(fit, recorded))
    for k, panel in enumerate(told["each"].panels):
        residual = panel.series[0].y * fit.noise.row[k]
        assert np.sqrt(np.mean(residual**2)) == pytest.approx(fit.residual_rms[k], rel=1e-6)
        assert list(panel.series[0].x) == list(range(40))
        assert panel.y.high == -panel.y.low >= np.abs(panel.series[0].y).max()


@pytest.mark.slow
def test_one_pose_that_is_off_is_named(fit, recorded):
    columns = dict(recorded.columns)
    off = columns["segment"] == 17
    columns["tz"] = columns["tz"] + 300.0 * fit.noise.row[5] * off
    page = words(fit_page(fit, replace(recorded, columns=columns)).html())
    assert re.search(r"The largest is tz of pose 17: \+3\.?\d*(e\+02|00)? times", page)


@pytest.mark.slow
def test_the_verdict_follows_the_fit(fit, recorded):
    page = fit_page(fit, recorded)
    assert page.context["badge"] == "◔ more is left"
    assert "wrenchbed diagnose rec.parquet --out found" in words(page.html())
    clean = replace(fit, noise=replace(fit.noise, inflated=False))
    assert fit_page(clean, recorded).context["badge"] == "✓ converged"
    refuted = replace(fit, refuted="the fit leaves 60 % of the swing")
    page = fit_page(refuted, recorded)
    assert page.context["badge"] == "✗ refuted" and page.context["verdict"] == "unknown"
    text = words(page.html())
    assert "The data refute these values: the fit leaves 60 % of the swing." in text
    assert "Do not use these values." in text and "export FIT" not in text


@pytest.mark.slow
def test_what_is_fixed_in_sum_only_has_no_interval_and_no_correlation(recorded):
    fit = wb.calibrate(recorded, wb.Options(free=("candidates",)))
    page = fit_page(fit, recorded)
    blind = [p.name for p in fit.identified if p.std is None]
    assert blind
    matrix = charts(page)["correlation"].panels[0].matrix
    assert not set(blind) & set(matrix.rows) and matrix.printed
    assert f"Without {len(blind)} parameters" in charts(page)["correlation"].caption
    assert f"rank {fit.observability.rank} of {len(fit.observability.names)}" in words(page.html())


@pytest.mark.slow
def test_a_motion_is_drawn_over_time_without_poses(recorded):
    robot = wb.load("robots", "ur5")
    t = 0.01 * np.arange(3000)
    q = robot.home + 0.4 * np.sin(0.7 * t[:, None] + np.arange(6))
    columns = {"t": t} | {f"q{k + 1}": q[:, k] for k in range(6)}
    columns |= dict.fromkeys(("fx", "fy", "fz", "tx", "ty", "tz"), np.zeros(len(t)))
    bare = wb.Recording(replace(recorded.metadata, mode="dynamic"), columns, "motion")
    model = wb.Model.of(robot, bare.metadata)
    moving = wb.simulate(wb.Twin(model, model.configured(bare.metadata)), bare, noise="white")
    page = fit_page(wb.calibrate(moving), moving)
    text, told = words(page.html()), charts(page)
    assert re.search(r"The largest is [ft][xyz] at [\d.]+ s:", text) and "pose" not in text
    assert told["each"].panels[0].x.label == "time"
    line = told["each"].panels[0].series[0]
    assert line.kind == "line" and line.std is None and "Upright" not in told["each"].caption
