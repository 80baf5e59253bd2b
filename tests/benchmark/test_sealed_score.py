"""Claims are held against answers."""

import json
import re
import shlex

import numpy as np
import pytest

from sealed_family import COUNT, SEED, truthful
from wrenchbed.benchmark.frame import EFFECTS
from wrenchbed.benchmark.scoring.case_rows import Claim
from wrenchbed.benchmark.scoring.metrics import Metric, ScoredMetric
from wrenchbed.benchmark.sealed import commitments, report, score
from wrenchbed.benchmark.sealed import make as making
from wrenchbed.benchmark.sealed.run import CLAIM
from wrenchbed.cli import main


def test_one_who_knows_is_right_and_one_who_swaps_is_wrong(family, tmp_path):
    cases, answers, _ = family
    truthful(cases, answers, tmp_path / "claims" / "knows")

    def swap(truth, claim):
        if truth.kind == "none":
            return Claim("unknown", (), {"unknown": 1.0})
        if truth.kind == "outside":
            return Claim("identified", (("sensor.drift",),), {"sensor.drift": 1.0})
        return Claim("none", (), {"none": 1.0})

    truthful(cases, answers, tmp_path / "claims" / "swaps", swap)
    found = report.summary(score.score(cases, tmp_path / "claims", answers, "knows"))
    good, bad = found["knows"], found["swaps"]
    right = ("isolation", "isolation_alike", "first", "unknown", "sure", "pairs", "where")
    assert all(good[k]["value"] == 1.0 for k in right)
    assert good["false_alarm"]["value"] == good["ece"]["value"] == 0.0
    assert all(bad[k]["value"] == 0.0 for k in ("isolation", "unknown", "sure", "pairs"))
    assert bad["false_alarm"]["value"] == bad["misnamed"]["value"] == 1.0
    assert found["oracle"]["isolation"]["value"] >= 0.9
    assert found["oracle"]["unknown"]["value"] == 1.0


def test_naming_what_cannot_be_told_from_the_truth_counts_apart(family, tmp_path):
    cases, answers, _ = family

    def imitate(truth, claim):
        if truth.kind == "single" and truth.causes[0].alike:
            other = truth.causes[0].alike[0]
            return Claim("identified", ((other,),), {other: 1.0})
        return claim

    truthful(cases, answers, tmp_path / "claims" / "me", imitate)
    told = report.summary(score.score(cases, tmp_path / "claims", answers))["me"]
    assert told["isolation_alike"]["value"] == 1.0
    assert told["isolation_unlike"]["value"] == 1.0
    assert told["isolation"]["value"] < 1.0


def test_numbers_are_held_against_true_ones(family, tmp_path):
    cases, answers, _ = family
    truthful(cases, answers, tmp_path / "claims" / "me")
    changed = 0
    for name in commitments.read(cases):
        truth = commitments.read_answer(commitments.answer_of(answers, name))
        path = tmp_path / "claims" / "me" / name / CLAIM
        told = json.loads(path.read_bytes())
        for cause, said in zip(truth.causes, told["which"], strict=False):
            if EFFECTS[cause.effect].compared and cause.effect != "joint.compliance":
                said["parameters"] = {k: {"value": v, "std": 1e-9} for k, v in cause.true.items()}
                changed += 1
        path.write_text(json.dumps(told))
    found = score.score(cases, tmp_path / "claims", answers)
    assert changed > 2
    assert report.summary(found)["me"]["coverage"]["value"] == 1.0


@pytest.mark.slow
def test_the_verbs_make_and_score(tmp_path, capsys, monkeypatch, family):
    cases, answers, root = family
    truthful(cases, answers, tmp_path / "claims" / "me")
    line = ["blind", "score", str(cases), str(tmp_path / "claims"), str(answers)]
    assert main([*line, "--out", str(tmp_path / "page")]) == 0
    assert root in capsys.readouterr().out.replace("\n", "")
    page = (tmp_path / "page" / "score.md").read_text()
    assert "Reliability" in page and "Wrong first answers" in page
    assert "Detection against size" in (tmp_path / "page" / "score.html").read_text()
    assert main([*line, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["cases"] == COUNT
    assert main([*line, "--method", "nobody"]) == 1
    assert "nobody" in capsys.readouterr().err
    make = ["blind", "make", "--out", str(tmp_path / "o"), "--answers", str(tmp_path / "a")]
    assert main([*make, "--cases", "1", "--seed", "-1"]) == 1
    assert main([*make, "--cases", "1", "--robot", "oriented"]) == 1
    assert "oriented" in capsys.readouterr().err


def test_a_made_family_goes_on_where_it_was_stopped(family, tmp_path):
    cases, answers, root = family
    assert making.resumed(answers) == SEED
    assert making.resumed(tmp_path) is None
    told = []
    again = making.make(
        making.Family("ur5", "static", COUNT, SEED),
        cases,
        answers,
        report=lambda n, *_: told.append(n),
    )
    assert again == root
    assert told == [COUNT]
    assert making.drawn_seed() != making.drawn_seed()


def test_probabilities_beside_how_often_they_hold(family, tmp_path):
    cases, answers, _ = family
    truthful(cases, answers, tmp_path / "claims" / "me")
    found = report.page(score.score(cases, tmp_path / "claims", answers))
    tables = [p for s in found.sections for p in s.parts if hasattr(p, "rows")]
    assert np.all([len(t.rows) > 0 for t in tables[:-1]])
    assert len(tables[-1].rows) == 0  # no wrong answers
    marks = {row[0]: row[1] for row in tables[0].rows}
    assert marks["first subsystem right"] == "≥ 97 % (✓)"  # 18 of 18: from 81 % on
    assert marks["seconds a case"] == ""
    html = found.html()
    text = re.sub(r"<script.*?</script>|<svg.*?</svg>", "", html, flags=re.DOTALL)
    assert "`" not in text and "<code>unknown</code>" in text
    assert "Every first answer is right." in text and "<tbody>\n</tbody>" not in text


def test_a_score_names_the_commitments_but_not_the_seed(family, tmp_path, monkeypatch):
    cases, answers, root = family
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    truthful(cases, answers, tmp_path / "claims" / "me")
    out = tmp_path / "page"
    words = ["blind", "score", *map(str, (cases, tmp_path / "claims", answers)), "--out", str(out)]
    assert main(words) == 0
    html = (out / "score.html").read_text()
    told = dict(re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>", html))
    assert told["SHA-256 of the commitments"] == root
    assert told["made"].startswith("2023-11-14 22:13 UTC by wrenchbed ")
    assert shlex.join(["wrenchbed", *words]) in re.search(r"<pre>(.*?)</pre>", html)[1]
    assert "seed" not in told and "--seed" not in html


@pytest.mark.parametrize(
    ("target", "ends", "mark"),
    [
        ("≥ 95 %", (0.96, 1.0), "✓"), ("≥ 95 %", (0.81, 1.0), "(✓)"),
        ("≥ 95 %", (0.5, 0.97), "(✗)"),
        ("≤ 3 %", (0.2, 0.6), "✗"), ("87–93 %", (0.88, 0.92), "✓"), ("87–93 %", (0.5, 0.99), "(✓)"),
        ("87–93 %", (0.95, 1.0), "✗"), ("0 %", (0.0, 0.3), "✓"), ("", (0.0, 1.0), ""),
    ],
)  # fmt: skip
def test_a_mark_stands_in_brackets_where_the_interval_allows_both(target, ends, mark):
    metric = Metric("x", target, lambda row, method: None, lambda sums: sums)
    value = {"(✓)": 0.97 if "≥" in target else 0.9, "(✗)": 0.9}.get(mark, sum(ends) / 2)
    value = 0.0 if target == "0 %" else value
    assert report.marked(metric, ScoredMetric(value, *ends, 20)) == mark


def test_the_first_screen_counts_targets_and_cases(family, tmp_path):
    cases, answers, _ = family
    truthful(cases, answers, tmp_path / "claims" / "me")
    page = report.page(score.score(cases, tmp_path / "claims", answers))
    (targets,) = page.cards
    marks = [row[1] for row in page.sections[0].parts[0].rows]
    met = sum("✓" in m for m in marks)
    assert targets.figure == f"{met} of {met + sum('✗' in m for m in marks)} met"
    assert f"For {sum('(' in m for m in marks)} of them" in targets.text
