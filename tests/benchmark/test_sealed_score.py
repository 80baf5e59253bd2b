"""Any program may enter, is held to the contract, and its claims against the answers."""

import json
import os
import re
import shlex
import sys
import time

import numpy as np
import pytest

from sealed_family import SAYS_NONE, script, truthful
from wrenchbed.benchmark.scoring.metrics import Metric, ScoredMetric
from wrenchbed.benchmark.scoring.truth_and_claims import Claim
from wrenchbed.benchmark.sealed import report, run, score
from wrenchbed.benchmark.sealed.run import CLAIM, RUN, Entrant, contract, enter
from wrenchbed.cli import main
from wrenchbed.effects.chain import effects
from wrenchbed.errors import BenchmarkError, ParameterError


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
    right = ("isolation", "isolation_alike", "unknown", "sure", "pairs", "where")
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
    assert told["isolation"]["value"] < 1.0


def test_probabilities_and_targets_stand_on_the_first_screen(family, tmp_path):
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
    assert "<p>None.</p>" in text and "<tbody>\n</tbody>" not in text
    *good, targets = found.cards
    assert [card.figure.split()[-1] for card in good] == [
        "right",
        "isolated",
        "unknown",
        "otherwise",
    ]
    assert all(card.figure in found.lead and "; target " in card.text for card in good)
    marks = [row[1] for row in tables[0].rows]
    met, marked = sum(m.endswith(" ✓") for m in marks), sum("✓" in m or "✗" in m for m in marks)
    assert targets.figure == f"{met} of {marked} met" and 0 < met < marked
    assert f"{sum('(' in m for m in marks)} are open" in targets.text
    missed = any(m.endswith(" ✗") for m in marks)
    assert f'class="badge">{"✗ targets missed" if missed else "◔ targets open"}<' in text


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
    monkeypatch.chdir(tmp_path / "claims")
    assert main(["blind", "score", str(cases), ".", str(answers)]) == 0
    assert (tmp_path / "claims.score" / "score.html").is_file()


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


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("sys.exit(3)", "exit code 3"),
        ("os.kill(os.getpid(), 9)", "exit code -9"),
        ("time.sleep(60)", "longer than 1 s"),
        ("", "wrote no diagnosis.json"),
    ],
)
def test_what_fails_is_a_wrong_answer(family, tmp_path, body, said):
    cases, answers, _ = family
    entrant = Entrant("broken", script(tmp_path, body))
    begun = time.monotonic()
    assert enter(cases, tmp_path / "claims", 1.0, ("0001", [entrant])) == ["broken"]
    assert time.monotonic() - begun < 20
    found = score.read(tmp_path / "claims" / "broken" / "0001")
    assert found.verdict == "error"
    assert said in found.error
    rows = score.score(cases, tmp_path / "claims", answers).rows
    assert all(r.claims["wrenchbed"].verdict == "error" for r in rows)


TWICE = {"verdict": "identified", "probabilities": {"tool.mass": 1.0}}
TWICE["which"] = [{"effect": "tool.mass", "probability": 1.0}] * 2


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"verdict": "perhaps"}, "perhaps"),
        ({"probabilities": {"none": 0.2}}, "sum"),
        ({"verdict": "identified"}, "0 causes"),
        ({"probabilities": {"none": 1.7, "unknown": -0.7}}, "not between"),
        ({"which": None}, "breaks the contract"),
        ({"probabilities": {"none": 10**400}}, "breaks the contract"),
        ({"probabilities": {"a|b|c|d|e|f": 1.0}}, "more than 5 members"),
        (TWICE, "named twice"),
    ],
)
def test_a_claim_that_breaks_the_contract_is_wrong(tmp_path, change, said):
    told = contract(Claim("none", (), {"none": 1.0}), "a.parquet", "ur5") | change
    (tmp_path / CLAIM).write_text(json.dumps(told))
    found = score.read(tmp_path)
    assert found.verdict == "error"
    assert said in found.error


def test_only_the_first_causes_count_and_odd_numbers_are_left_out(tmp_path):
    odd = {"stiffness": {"value": 0.0, "std": 1.0}, "x": {"value": "wide"}, "y": 3, "z": {}}
    odd |= {"fine": {"value": 1.0, "std": float("inf")}}
    names = "joint.compliance tool.mass tool.cog sensor.gain sensor.drift base.tilt".split()
    same = {"probability": 0.5, "parameters": odd, "elements": names}
    told = {
        "verdict": "identified", "which": [{"effect": n} | same for n in names], "probabilities":
        {"none": 1.0}, "gap": {"configured": float("nan"), "floor": "low", "calibrated": 2.0},
    }  # fmt: skip
    (tmp_path / CLAIM).write_text(json.dumps(told))
    found = score.read(tmp_path)
    assert len(found.causes) == len(found.elements["tool.mass"]) == score.COUNTED
    assert found.error == "" and found.gap == {"calibrated": 2.0}
    assert set(found.parameters["tool.mass"]) == {"stiffness", "fine"}
    assert found.parameters["tool.mass"]["fine"]["std"] is None
    assert effects()["joint.compliance"].amplitudes(found.parameters["joint.compliance"]) is None


def test_a_claim_belongs_to_one_case(family, tmp_path):
    cases, answers, _ = family
    entrant = Entrant("me", script(tmp_path, SAYS_NONE))
    assert enter(cases, tmp_path / "claims", 20.0, ("0001", [entrant])) == []
    (tmp_path / "claims" / "me" / "0001").rename(tmp_path / "claims" / "me" / "0002")
    with pytest.raises(BenchmarkError, match="another family"):
        run.run(cases, tmp_path / "claims", [entrant])
    found = score.score(cases, tmp_path / "claims", answers)
    errors = {row.claims["wrenchbed"].error for row in found.rows}
    assert errors == {"no claim", "the claim is about another case"}


def test_names_of_entrants_do_not_collide(tmp_path):
    methods = ["./none.sh", "bin/diagnose", "/a/method", "/b/method", "§"]
    names = [Entrant.of(m).name for m in methods]
    assert len(set(names)) == 5
    assert not {"none", "diagnose", ""} & set(names)
    for bad in ("", "'open"):
        with pytest.raises(ParameterError, match="give diagnose"):
            Entrant.of(bad)
    (tmp_path / "oracle").mkdir()
    with pytest.raises(BenchmarkError, match="no name for an entrant"):
        score.entrants(tmp_path)


def test_an_entrant_that_throws_its_folder_away_is_wrong(family, tmp_path):
    cases, _, _ = family
    entrant = Entrant("me", script(tmp_path, "import shutil\nshutil.rmtree(out)\n"))
    assert enter(cases, tmp_path / "claims", 20.0, ("0001", [entrant])) == ["me"]
    messy = Entrant(
        "you", script(tmp_path, "os.makedirs(os.path.join(out, 'a', 'b'))\n" + SAYS_NONE)
    )
    for _ in range(2):
        assert enter(cases, tmp_path / "claims", 20.0, ("0001", [messy])) == []


LEAVES_A_DAEMON = """
if os.fork() == 0:
    os.setsid()
    if os.fork() == 0:
        open(os.environ["LEFT"], "w").write(str(os.getpid()))
        time.sleep(60)
    os._exit(0)
while not os.path.exists(os.environ["LEFT"]) or not open(os.environ["LEFT"]).read():
    time.sleep(0.01)
"""
MOVES_ITS_FOLDER = "os.rename(out, out + '-x')\nos.symlink(os.environ['LEFT'], out)\n"
WRITES_WITHOUT_END = "open(os.path.join(out, 'big'), 'wb').truncate(2**34)\n"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the kernel's subreaper")
def test_what_an_entrant_leaves_running_ends_with_it(family, tmp_path, monkeypatch):
    left = tmp_path / "pid"
    monkeypatch.setenv("LEFT", str(left))
    me = Entrant("me", script(tmp_path, LEAVES_A_DAEMON + SAYS_NONE))
    assert enter(family[0], tmp_path / "claims", 20.0, ("0001", [me])) == []
    with pytest.raises(ProcessLookupError):
        os.kill(int(left.read_text()), 0)


@pytest.mark.parametrize("attack", [MOVES_ITS_FOLDER, WRITES_WITHOUT_END])
def test_what_an_entrant_writes_is_bounded_and_stays_in_its_folder(
    family, tmp_path, monkeypatch, attack
):
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.setenv("LEFT", str(tmp_path / "elsewhere"))
    me = Entrant("me", script(tmp_path, attack + SAYS_NONE))
    assert enter(family[0], tmp_path / "claims", 20.0, ("0001", [me])) == ["me"]
    assert not (tmp_path / "elsewhere" / RUN).exists()
    folder = tmp_path / "claims" / "me" / "0001"
    assert folder.is_dir() and not folder.is_symlink()
    assert sum(p.stat().st_size for p in folder.rglob("*")) < 2**27


DEEP = "[" * 200_000 + "]" * 200_000


def test_a_claim_too_deep_or_too_long_is_a_wrong_answer(tmp_path):
    for text, why in ((DEEP, "nested more than"), (" " * (2**25 + 1), "longer than")):
        (tmp_path / CLAIM).write_text(text)
        assert why in score.read(tmp_path).error
    (tmp_path / RUN).write_text(DEEP)
    assert "is broken" in score.read(tmp_path).error
