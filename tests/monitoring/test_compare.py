"""Comparisons of results: changes are found, their σ are right, false alarms stay rare."""

import json
import re

import numpy as np
import pytest
from scipy import stats

import wrenchbed as wb
from simulated import UR5_TRUTH, WHITE, driven, static
from wrenchbed.cli import main
from wrenchbed.errors import ParameterError
from wrenchbed.monitoring.compare import LEVEL, compare, holm

CHANGED = UR5_TRUTH | {"tool.mass": UR5_TRUTH["tool.mass"] + 0.02}


@pytest.fixture(scope="module")
def fits(tmp_path_factory):
    """Two of one robot, and one whose tool is 20 g heavier."""
    folder = tmp_path_factory.mktemp("fits")
    for name, truth, seed in (("a", UR5_TRUTH, 0), ("b", UR5_TRUTH, 1), ("c", CHANGED, 2)):
        recording = static("ur5", truth, poses=40, samples=10, noise=WHITE, seed=seed)
        recording.write(folder / f"{name}.parquet")
        fit = wb.calibrate(wb.Recording.read(folder / f"{name}.parquet"))
        fit.write(folder / f"{name}.json")
    return folder


def test_a_heavier_tool_is_the_one_change(fits):
    found = compare(fits / "a.json", fits / "c.json")
    assert [c.name for c in found.changes if c.changed] == ["tool.mass"] and found.changed
    mass = next(c for c in found.changes if c.changed)
    assert mass.after - mass.before == pytest.approx(0.02, abs=4 * mass.std)
    assert found.sentences[0].startswith(f"1 of {len(found.changes)} numbers changed: tool.mass: +")
    assert f"({abs(mass.sigmas):.1f} σ)" in found.sentences[0] and found.together["p"] < 1e-6
    for cells in (c.cells[1:4] for c in found.changes):  # one unit and as many decimals in a row
        assert len({re.sub(r"[^a-zN°·]", "", x) for x in cells}) == 1, cells
        assert len({len(x) for cell in cells for x in re.findall(r"\.(\d+)", cell)}) <= 1, cells


def test_two_recordings_of_one_robot_agree_and_fits_of_the_same_rows_share_their_noise(fits):
    (fits / "b.pq").hardlink_to(fits / "b.parquet")  # whatever the suffix
    found = compare(fits / "a.parquet", fits / "b.pq")
    assert not found.changed and found.kind == "recordings"
    assert found.sentences[0].startswith("no change: ") and found.together["p"] > LEVEL
    found = compare(fits / "a.json", fits / "a.json")
    assert any("share their noise" in s for s in found.sentences)


def test_sigma_and_chi2_are_those_of_the_covariances(fits):
    raw = [json.loads((fits / f"{n}.json").read_text()) for n in "ab"]
    found = compare(fits / "a.json", fits / "b.json")
    names = list(raw[0]["parameters"])
    values = [[r["parameters"][n]["value"] for n in names] for r in raw]
    d = np.subtract(values[1], values[0])
    c = np.array(raw[0]["covariance"]) + np.array(raw[1]["covariance"])
    assert [x.name for x in found.changes] == names
    assert [x.sigmas for x in found.changes] == pytest.approx(d / np.sqrt(np.diagonal(c)))
    chi2 = float(d @ np.linalg.solve(c, d))
    want = {"chi2": chi2, "dof": len(d), "p": float(stats.chi2.sf(chi2, len(d)))}
    assert found.together == pytest.approx(want, rel=1e-6)


def test_false_alarms_stay_within_the_level():
    """Holm over 12 normal numbers: 2,000 draws raise at most 1 %, give or take three σ."""
    rng = np.random.default_rng(7)
    p = 2.0 * stats.norm.sf(np.abs(rng.standard_normal((2000, 12))))
    rate = np.mean([holm(row).any() for row in p])
    assert 0.002 < rate < LEVEL + 3.0 * np.sqrt(LEVEL / 2000)
    assert holm(np.array([0.2, 1e-9, 0.004])).tolist() == [False, True, True]


def test_a_number_that_is_known_in_sum_only_is_left_out(fits, tmp_path):
    recording = wb.Recording.read(fits / "a.parquet")
    free = ("default", "dq6")
    wb.calibrate(recording, wb.Options(free=free)).write(tmp_path / "sum.json")
    found = compare(tmp_path / "sum.json", fits / "b.json")
    assert "mount.rotation.z" not in {c.name for c in found.changes}
    assert any(x.startswith("dq6") and "only in combination" in x for x in found.left)


def test_diagnoses_are_compared_by_verdict_causes_and_numbers(tmp_path):
    def diagnosis(name, verdict, gap, **causes):
        sizes = {n: {"x": {"value": v, "std": 0.1, "unit": "N"}} for n, v in causes.items()}
        which = [{"effect": n.replace("_", "."), "parameters": x} for n, x in sizes.items()]
        interval = {"calibrated": gap, "calibrated_ci95": [gap - 0.5, gap + 0.5]}
        raw = {"robot": "ur5", "verdict": verdict, "gap": interval, "which": which}
        (tmp_path / name).mkdir()
        (tmp_path / name / "diagnosis.json").write_text(json.dumps(raw))
        return tmp_path / name

    a = diagnosis("a", "identified", 3.0, sensor_drift=1.0, cable_pull=2.0)
    b = diagnosis("b", "ambiguous", 6.0, sensor_drift=2.0, base_tilt=1.0)
    found = compare(a, b)
    assert found.sentences[:4] == (
        "verdict: identified → ambiguous",
        "cable.pull: named → not named",
        "base.tilt: not named → named",
        "gap after calibration: 3 → 6",
    )
    (drift,) = found.changes
    assert drift.changed and drift.sigmas == pytest.approx(1.0 / np.hypot(0.1, 0.1))
    assert not compare(a, a).changed


@pytest.mark.parametrize(
    ("second", "why"),
    [
        ("a.parquet", "is a fit and .*a.parquet is a recording"),
        ("none.json", "there is no such file"),
        ("other.json", "is of robot 'ur5', .* of 'medrue'"),
        ("text.json", "is no recording, fit or diagnosis"),
        ("short.json", "covariance must be a matrix of"),
    ],
)
def test_what_cannot_be_compared_is_refused(fits, second, why):
    raw = json.loads((fits / "b.json").read_text())
    (fits / "other.json").write_text(json.dumps(raw | {"robot": "medrue"}))
    (fits / "short.json").write_text(json.dumps(raw | {"covariance": [[1.0]]}))
    (fits / "text.json").write_text("{}")
    with pytest.raises(ParameterError, match=why):
        compare(fits / "a.json", fits / second)


def test_the_terminal_page_and_json_say_the_same(fits, capsys):
    line, page = ["compare", str(fits / "a.json"), str(fits / "c.json")], fits / "page.html"
    assert main([*line, "--out", str(page)]) == 0
    shown = capsys.readouterr().out
    assert main([*line, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["sentences"][0].split(" (")[0] in " ".join(shown.split())
    mass = next(c for c in told["changes"] if c["changed"])
    assert f"{mass['sigmas']:+.1f}" in shown and told["changed"] is True
    assert "…" not in shown and " -" not in shown  # nothing is cut at 80 columns
    html = page.read_text(encoding="utf-8")
    assert (
        "◔ changed" in html and "1 of 13 numbers" in html and f"{mass['sigmas']:.1f} σ</p>" in html
    )
    assert "of 13 counts from 3.4 σ on" in html.replace("\u00a0", " ")
    assert html.count('<tr class="best">') == 1


def test_what_no_compared_number_explains_is_a_change(tmp_path):
    plan = wb.poses(wb.load("robots", "ur5"), 24, 0)
    for name, effects in (("june", ()), ("july", ("base.tilt:x=0.004",))):
        driven(plan, tmp_path / f"{name}.parquet", 30, seed=len(effects), effects=effects)
    found = compare(tmp_path / "june.parquet", tmp_path / "july.parquet")
    assert found.changed and not any(c.changed for c in found.changes)
    assert found.sentences[0].startswith("what these numbers do not explain went from 1.")
    assert len(found.sentences[0]) < 85 and "diagnose" in found.sentences[1]  # two lines on A4
    ratio = re.search(r'"big">([\d.]+) ×</p>.*it counts from 3 times on', found.page().html(), re.S)
    assert float(ratio[1]) > 3.0
