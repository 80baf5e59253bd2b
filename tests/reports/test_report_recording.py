"""The report of a recording and its fits, and where the numbers of results come from."""

import hashlib
import json
import re
import shlex
from dataclasses import replace
from html import unescape
from importlib.metadata import version
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from test_report import words

import ntnu
import wrenchbed as wb
from simulated import driven
from wrenchbed import studies
from wrenchbed.cli import main
from wrenchbed.pages.document import Document, Section
from wrenchbed.pages.draw import Drawn
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.reports.recording_page import agreements, recording_page
from wrenchbed.twin.simulator_predictions import noise_of, simulators


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A UR5 whose tool is 0.2 kg heavier than stated, its fit, and the pages of both."""
    folder = tmp_path_factory.mktemp("report")
    robot = wb.load("robots", "ur5")
    truth = {"tool.mass": 1.55}
    path = folder / "rec.parquet"
    recording = driven(wb.poses(robot, 40, seed=1), path, parameters=truth, seed=1)
    wb.calibrate(recording).write(folder / "fit.json")
    return folder


def text(page) -> str:
    return words(page.html())


@pytest.mark.slow
def test_a_fit_that_agrees_says_so_with_its_figures(folder):
    recording = wb.Recording.read(folder / "rec.parquet")
    page = recording_page(recording, [folder / "fit.json"], "the command")
    told, fit = text(page), json.loads((folder / "fit.json").read_text())
    stated = "noise of one row (as stated)"
    for wanted in ("fit agrees with the recording in every", "40 poses at rest", stated):
        assert wanted in told
    assert f"{fit['tool']['mass']:.4g} kg" in told and "the command" in told
    assert hashlib.sha256((folder / "rec.parquet").read_bytes()).hexdigest() in told
    assert f"wrenchbed {version('wrenchbed')}" in told and " UTC by " in told
    ratio = float(re.search(r"([\d.]+) × noise", told)[1])
    assert 0.9 < ratio < 1.25
    assert "Use this simulator" in told


@pytest.mark.slow
def test_one_channel_that_differs_is_no_agreement(folder):
    """tz at 1.87 times its noise: over all channels that is 1.2 and looked like noise."""
    recording = wb.Recording.read(folder / "rec.parquet")
    known = simulators(recording, [folder / "fit.json"])
    noise = noise_of(recording)
    before = agreements(recording, known, noise)[1]
    assert not before.differing
    columns = dict(recording.columns)
    columns["tz"] = columns["tz"] + noise[5] * np.sqrt(1.87**2 - before.ratios[5] ** 2)
    shifted = replace(recording, columns=columns)
    after = agreements(shifted, known, noise)[1]
    assert after.ratios[5] == pytest.approx(1.87, abs=0.05) and after.overall < 1.25
    page = recording_page(shifted, [folder / "fit.json"], "")
    told = text(page)
    assert "differs slightly from the recording in tz." in told and "tz 1.8" in told
    assert "✓ agree" not in told and "Use this simulator" not in told


def test_a_simulator_that_is_off_is_named_beside_each_channels_means(folder, monkeypatch):
    monkeypatch.setattr("wrenchbed.reports.recording_page.draw", lambda c: Drawn(c, "<svg></svg>"))
    recording = wb.Recording.read(folder / "rec.parquet")
    page = recording_page(recording, [], "")
    told = text(page)
    assert "The best simulator, configured, differs much from the recording in " in told
    assert "wrenchbed calibrate rec.parquet --out fit.json" in told
    assert "Nothing was fitted" in told
    charts = {f.chart.name: f.chart for f in page.figures}
    assert set(charts) == {*CHANNELS, "joints"}
    rows = recording.wrench.reshape(40, 20, 6)
    for k, channel in enumerate(CHANNELS):
        above, below = charts[channel].panels
        measured, simulated = above.series
        assert measured.kind == "points" and len(measured.x) == 40
        assert np.allclose(measured.y, rows[:, :, k].mean(axis=1))
        assert np.allclose(measured.std, rows[:, :, k].std(axis=1))
        assert below.y.unit == "noise" and simulated.name == below.series[0].name
        assert "differs" in charts[channel].caption or "agrees" in charts[channel].caption
        assert charts[channel].caption in told
    assert len(charts["joints"].panels) == 6


def test_without_a_model_the_readings_alone_are_shown():
    recording = ntnu.static()
    page = recording_page(recording, [], "")
    assert [f.chart.name for f in page.figures] == list(CHANNELS)
    told = text(page)
    assert "Readings alone: there is no model of robot kuka-lbr-med14" in told
    assert "agree" not in told and "noise of a row 0.035 N, as stated" in told
    (panel,) = page.figures[2].chart.panels
    assert np.array_equal(panel.series[0].y, recording.wrench[:, 2])
    assert panel.series[0].kind == "points"  # nothing is known of the way between two rows at rest


def told(html: str) -> dict[str, str]:
    """Facts of a page by their label, and its command."""
    rows = re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>", html)
    command = re.search(r"<pre>(.*?)</pre>", html)
    return {k: unescape(v) for k, v in [*rows, ("command", command[1] if command else "")]}


def sha256(path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.fixture
def made_then(monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    monkeypatch.setattr("wrenchbed.pages.document.draw", lambda c: Drawn(c, "<svg></svg>"))
    monkeypatch.setattr("wrenchbed.pages.document.svg", lambda *_, **__: "<svg></svg>")
    return f"2023-11-14 22:13 UTC by wrenchbed {version('wrenchbed')}"


@pytest.mark.slow
def test_a_campaign_says_what_its_numbers_are_of_and_how_to_make_them_again(
    tmp_path, made_then, capsys
):
    out = tmp_path / "a campaign"
    options = ["--robots", "2", "--poses", "12", "--samples", "6", "--seed", "5"]
    assert main(["campaign", "ur5", "--out", str(out), "--workers", "1", *options]) == 0
    facts = told((out / "summary.html").read_text())
    assert facts["made"] == made_then and facts["seed"] == "5"
    for name in ("robots.parquet", "campaign.json"):
        assert facts[f"SHA-256 of {name}"] == sha256(out / name)
        assert sha256(out / name) in (out / "summary.md").read_text()
    capsys.readouterr()
    before = pq.read_table(out / "robots.parquet")["fit.tool.mass"].to_pylist()
    words = shlex.split(facts["command"])
    (out / "robots.parquet").unlink()
    assert words[0] == "wrenchbed" and main(words[1:]) == 0
    assert pq.read_table(out / "robots.parquet")["fit.tool.mass"].to_pylist() == before


def test_a_study_names_the_results_behind_it(tmp_path, made_then, monkeypatch):
    def run(folder, quick, robots, seed, report):
        pq.write_table(pa.table({"x": [1.0]}), folder / "trials.parquet")
        return Document("T", "Lead.", (Section("S", "text"),), "three trials")

    module = SimpleNamespace(run=run, steps=lambda quick, robots: 1)
    monkeypatch.setattr(studies, "_module", lambda paper: module)
    out = tmp_path / "s"
    assert main(["study", "ur5", "--out", str(out), "--quick", "--seed", "4"]) == 0
    html = (out / "ur5.html").read_text()
    assert told(html) == {
        "SHA-256 of trials.parquet": sha256(out / "trials.parquet"),
        "made": made_then,
        "seed": "4",
        "command": shlex.join(["wrenchbed", "study", "ur5", "--out", str(out), "--quick", "--seed",
                               "4"]),
    }  # fmt: skip
    assert "<p>three trials</p>" in html
    assert f"- made: {made_then}" in (out / "ur5.md").read_text()
