"""The sealed benchmark: what is sealed stays sealed, claims are held to the contract."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from wrenchbed.blind import answer, claims, making, report, running, scoring, seal
from wrenchbed.blind.attack import attack
from wrenchbed.blind.entrant import CLAIM, RUN, Entrant, contract, enter
from wrenchbed.cli import main
from wrenchbed.diagnosis.linear import Claim
from wrenchbed.errors import BenchmarkError, ParameterError
from wrenchbed.recording import Recording
from wrenchbed.referee import setting as settings

COUNT, SEED = 32, 20


@pytest.fixture(scope="module")
def family(tmp_path_factory):
    """Cases and answers of small robots, made in this process."""
    folder = tmp_path_factory.mktemp("sealed")
    patch = pytest.MonkeyPatch()
    patch.setattr(settings, "POSES", (12, 20))
    patch.setattr(settings, "SAMPLES", 6)
    cases, answers = folder / "cases", folder / "answers"
    told = making.Family("ur5", "static", COUNT, SEED)
    making._begin(told, cases, answers)
    for index, kind in enumerate(told.kinds()):
        making._one(told, index, kind, cases, answers)
    root = making.make(told, cases, answers)  # nothing is left but to commit
    patch.undo()
    return cases, answers, root


@pytest.fixture
def copied(family, tmp_path):
    """A family that may be spoiled."""
    import shutil

    cases, answers, _ = family
    return (
        Path(shutil.copytree(cases, tmp_path / "cases")),
        Path(shutil.copytree(answers, tmp_path / "answers")),
    )


def truthful(cases, answers, folder, twist=lambda truth, claim: claim):
    """Claims of one who knows."""
    for name in seal.read(cases):
        truth = answer.read(seal.answer_of(answers, name))
        if truth.kind == "outside":
            claim = Claim("unknown", (), {"unknown": 1.0})
        elif truth.kind == "none":
            claim = Claim("none", (), {"none": 1.0})
        else:
            told = tuple((c.effect,) for c in truth.causes)
            claim = Claim("identified", told, {truth.causes[0].effect: 1.0})
        own = folder / name
        own.mkdir(parents=True)
        told = contract(twist(truth, claim), f"{name}.parquet", truth.robot)
        (own / CLAIM).write_text(json.dumps(told))
        (own / RUN).write_text('{"seconds": 1.0, "error": ""}')


# ---- what is sealed ------------------------------------------------------------------------------


def test_shares_of_kinds_are_as_promised():
    kinds = making.Family("ur5", "static", 300, 1).kinds()
    count = {k: kinds.count(k) for k in set(kinds)}
    assert count == {"none": 75, "single": 120, "pair": 45, "outside": 60}
    assert kinds != sorted(kinds)
    assert making.Family("ur5", "static", 300, 2).kinds() != kinds


def test_cases_hold_recordings_and_commitments_only(family):
    cases, answers, root = family
    assert len(list(cases.iterdir())) == COUNT + 1
    assert seal.digest((cases / seal.COMMITMENTS).read_bytes()) == root
    assert len(seal.verify(cases, answers)) == COUNT
    data = Recording.read(seal.recording_of(cases, "0001"))
    assert data.metadata.extra == {}
    text = (cases / seal.COMMITMENTS).read_text()
    assert "salt" not in text and "effect" not in text


def test_a_salt_hides_what_few_answers_there_are(family):
    _, answers, _ = family
    salts = {answer.read(p).salt for p in answers.glob("0*.json")}
    assert len(salts) == COUNT
    assert all(len(s) == 64 for s in salts)


def test_the_same_seed_makes_the_same_bytes(family, tmp_path, monkeypatch):
    cases, answers, _ = family
    monkeypatch.setattr(settings, "POSES", (12, 20))
    monkeypatch.setattr(settings, "SAMPLES", 6)
    told = making.Family("ur5", "static", COUNT, SEED)
    making._begin(told, tmp_path / "c", tmp_path / "a")
    making._one(told, 2, told.kinds()[2], tmp_path / "c", tmp_path / "a")
    for folder, other, file in ((cases, "c", "0003.parquet"), (answers, "a", "0003.json")):
        assert (folder / file).read_bytes() == (tmp_path / other / file).read_bytes()


def test_files_bear_one_time(family):
    cases, _, _ = family
    assert {p.stat().st_mtime for p in cases.iterdir()} == {making.EPOCH}


@pytest.mark.parametrize("which", ["recording", "answer", "commitments", "root"])
def test_what_was_tampered_with_is_refused(copied, which, tmp_path):
    cases, answers = copied
    truthful(cases, answers, tmp_path / "claims" / "me")
    scoring.score(cases, tmp_path / "claims", answers)
    path = {
        "recording": seal.recording_of(cases, "0002"),
        "answer": seal.answer_of(answers, "0002"),
        "commitments": cases / seal.COMMITMENTS,
        "root": answers / seal.FAMILY,
    }[which]
    data = bytearray(path.read_bytes())
    if which == "answer":
        data = bytearray(bytes(data).replace(b'"minor": 0', b'"minor": 1', 1))
    elif which == "root":
        data = bytearray(json.dumps(json.loads(data) | {"commitments": "0" * 64}).encode())
    elif which == "commitments":  # of a case and its commitment together
        recording = seal.recording_of(cases, "0002")
        recording.write_bytes(recording.read_bytes() + b" ")
        told = json.loads(data)
        told["cases"]["0002"]["recording"] = seal.digest(recording.read_bytes())
        data = bytearray((json.dumps(told, indent=1) + "\n").encode())
    else:
        data[len(data) // 2] ^= 1
    path.write_bytes(bytes(data))
    with pytest.raises(BenchmarkError, match="was changed"):
        scoring.score(cases, tmp_path / "claims", answers)


def test_what_was_sealed_is_not_sealed_again(copied):
    cases, answers = copied
    told = making.Family("ur5", "static", COUNT, SEED)
    root = making.make(told, cases, answers)
    path = seal.answer_of(answers, "0003")
    path.write_bytes(path.read_bytes().replace(b'"minor": 0', b'"minor": 1', 1))
    with pytest.raises(BenchmarkError, match=r"0003\.json: was changed"):
        making.make(told, cases, answers)
    assert seal.digest((cases / seal.COMMITMENTS).read_bytes()) == root


def test_all_files_together_cannot_be_changed_behind_what_was_published(copied, tmp_path):
    cases, answers = copied
    truthful(cases, answers, tmp_path / "claims" / "me")
    root = seal.digest((cases / seal.COMMITMENTS).read_bytes())
    scoring.score(cases, tmp_path / "claims", answers, published=root)
    told = json.loads((cases / seal.COMMITMENTS).read_bytes())
    path = seal.answer_of(answers, "0003")
    path.write_bytes(path.read_bytes().replace(b'"minor": 0', b'"minor": 1', 1))
    told["cases"]["0003"]["answer"] = seal.digest(path.read_bytes())
    text = json.dumps(told).encode()
    (cases / seal.COMMITMENTS).write_bytes(text)
    family = json.loads((answers / seal.FAMILY).read_bytes()) | {"commitments": seal.digest(text)}
    (answers / seal.FAMILY).write_text(json.dumps(family))
    scoring.score(cases, tmp_path / "claims", answers)  # nobody could tell
    with pytest.raises(BenchmarkError, match="what was published"):
        scoring.score(cases, tmp_path / "claims", answers, published=root)


def test_a_case_cannot_be_called_a_path(copied):
    cases, _ = copied
    told = json.loads((cases / seal.COMMITMENTS).read_bytes())
    told["cases"]["../../x"] = told["cases"]["0001"]
    (cases / seal.COMMITMENTS).write_text(json.dumps(told))
    with pytest.raises(BenchmarkError, match="no name of a case"):
        seal.read(cases)


def test_a_missing_answer_is_refused(copied, tmp_path):
    cases, answers = copied
    truthful(cases, answers, tmp_path / "claims" / "me")
    seal.answer_of(answers, "0005").unlink()
    with pytest.raises(BenchmarkError, match=r"0005\.json: is missing"):
        scoring.score(cases, tmp_path / "claims", answers)


def test_answers_lie_apart_and_families_do_not_mix(tmp_path, family):
    cases, answers, _ = family
    told = making.Family("ur5", "static", 2, 1)
    for where in (tmp_path, tmp_path / "inside"):
        with pytest.raises(BenchmarkError, match="apart"):
            making.make(told, tmp_path, where)
    with pytest.raises(BenchmarkError, match="another family"):
        making.make(told, cases, answers)
    (tmp_path / "x").mkdir()
    (tmp_path / "x" / "notes.txt").write_text("mine")
    with pytest.raises(BenchmarkError, match=r"notes\.txt"):
        making.make(told, tmp_path / "x", tmp_path / "y")
    with pytest.raises(ParameterError, match="empty"):
        making.Family("ur5", "static", 0, 1)


def test_nothing_but_wrench_and_joints_tells_the_answer(family):
    cases, answers, _ = family
    for found in attack(cases, answers):
        assert found.p_value > 0.01, found
        assert abs(found.accuracy - found.chance) < 0.3, found


def test_the_attack_finds_a_leak(copied):
    cases, answers = copied
    for name in seal.read(cases):
        kind = answer.read(seal.answer_of(answers, name)).kind
        path = seal.recording_of(cases, name)
        when = making.EPOCH + 1000 * ("none", "single", "pair", "outside").index(kind)
        os.utime(path, (when, when))
        data = Recording.read(path)
        columns = dict(data.columns) | {kind: data.t}
        making.write_plain(Recording(data.metadata, columns, name), path)
        os.utime(path, (when, when))
    assert attack(cases, answers)[0].p_value < 0.05


# ---- entrants ------------------------------------------------------------------------------------


def script(tmp_path, body):
    path = tmp_path / "method.py"
    path.write_text("import json, os, sys, time\nout = sys.argv[3]\n" + body)
    return f"{sys.executable} {path}"


SAYS_NONE = """
told = {"format": 1, "verdict": "none", "which": [], "probabilities": {"none": 1.0}}
open(os.path.join(out, "diagnosis.json"), "w").write(json.dumps(told))
"""


def test_any_program_may_enter_and_goes_on_after_a_stop(family, tmp_path):
    cases, answers, _ = family
    entrant = Entrant("says-none", script(tmp_path, SAYS_NONE))
    assert running.run(cases, tmp_path / "claims", [entrant]) == {"says-none": 0}
    told = []
    running.run(cases, tmp_path / "claims", [entrant], tell=lambda n, *_: told.append(n))
    assert told == [COUNT]  # all were there
    found = scoring.score(cases, tmp_path / "claims", answers)
    figures = report.summary(found)["says-none"]
    assert figures["false_alarm"]["value"] == 0.0
    assert figures["isolation"]["value"] == 0.0


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
    assert enter([entrant], cases, "0001", tmp_path / "claims", 1.0) == ["broken"]
    assert time.monotonic() - begun < 20
    found = claims.read(tmp_path / "claims" / "broken" / "0001")
    assert found.claim.verdict == "error"
    assert said in found.error
    rows = scoring.score(cases, tmp_path / "claims", answers).rows
    assert all(r.answers["wrenchbed"].verdict == "error" for r in rows)


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
        (
            {
                "verdict": "identified",
                "which": [{"effect": "tool.mass", "probability": 1.0}] * 2,
                "probabilities": {"tool.mass": 1.0},
            },
            "named twice",
        ),
    ],
)
def test_a_claim_that_breaks_the_contract_is_wrong(tmp_path, change, said):
    told = contract(Claim("none", (), {"none": 1.0}), "a.parquet", "ur5") | change
    (tmp_path / CLAIM).write_text(json.dumps(told))
    found = claims.read(tmp_path)
    assert found.claim.verdict == "error"
    assert said in found.error


def test_only_the_first_causes_count_and_odd_numbers_are_left_out(tmp_path):
    odd = {"stiffness": {"value": 0.0, "std": 1.0}, "x": {"value": "wide"}, "y": 3, "z": {}}
    odd |= {"fine": {"value": 1.0, "std": float("inf")}}
    names = [
        "joint.compliance",
        "tool.mass",
        "tool.cog",
        "sensor.gain",
        "sensor.drift",
        "base.tilt",
    ]
    which = [{"effect": n, "probability": 0.5, "parameters": odd} for n in names]
    told = {
        "verdict": "identified", "which": which, "probabilities": {"none": 1.0},
        "gap": {"configured": float("nan"), "floor": "low", "calibrated": 2.0},
    }  # fmt: skip
    (tmp_path / CLAIM).write_text(json.dumps(told))
    found = claims.read(tmp_path)
    assert found.error == ""
    assert len(found.claim.causes) == claims.COUNTED
    assert found.gap == {"calibrated": 2.0}
    assert set(found.parameters["tool.mass"]) == {"stiffness", "fine"}
    assert found.parameters["tool.mass"]["fine"]["std"] is None
    assert not scoring._usable(found.parameters["joint.compliance"])


def test_a_claim_belongs_to_one_case(family, tmp_path):
    cases, answers, _ = family
    entrant = Entrant("me", script(tmp_path, SAYS_NONE))
    assert enter([entrant], cases, "0001", tmp_path / "claims", 20.0) == []
    (tmp_path / "claims" / "me" / "0001").rename(tmp_path / "claims" / "me" / "0002")
    with pytest.raises(BenchmarkError, match="another family"):
        running.run(cases, tmp_path / "claims", [entrant])
    found = scoring.score(cases, tmp_path / "claims", answers)
    assert {r.error for r in found.rows} == {"no claim", "the claim is about another case"}


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
        claims.entrants(tmp_path)


def test_an_entrant_that_throws_its_folder_away_is_wrong(family, tmp_path):
    cases, _, _ = family
    entrant = Entrant("me", script(tmp_path, "import shutil\nshutil.rmtree(out)\n"))
    assert enter([entrant], cases, "0001", tmp_path / "claims", 20.0) == ["me"]
    messy = Entrant(
        "you", script(tmp_path, "os.makedirs(os.path.join(out, 'a', 'b'))\n" + SAYS_NONE)
    )
    for _ in range(2):
        assert enter([messy], cases, "0001", tmp_path / "claims", 20.0) == []


def test_our_own_methods_answer_a_case(tmp_path, monkeypatch):
    monkeypatch.setattr(settings, "POSES", (24, 24))
    monkeypatch.setattr(settings, "SAMPLES", 10)
    cases, answers = tmp_path / "cases", tmp_path / "answers"
    told = making.Family("ur5", "static", 1, 3)
    making._begin(told, cases, answers)
    making._one(told, 0, "none", cases, answers)
    making.make(told, cases, answers)
    entrants = [Entrant.of(m) for m in ("bic", "diagnose", "none")]
    assert enter(entrants, cases, "0001", tmp_path / "claims", 120.0) == []
    for entrant in entrants:
        assert claims.read(tmp_path / "claims" / entrant.name / "0001").error == ""
    assert enter(entrants[1:2], cases, "0001", tmp_path / "claims", 0.01) == ["diagnose"]
    found = claims.read(tmp_path / "claims" / "diagnose" / "0001")
    assert "longer than" in found.error


def test_a_run_that_was_killed_goes_on(family, tmp_path):
    cases, _, _ = family
    slow = script(tmp_path, "time.sleep(0.2)\n" + SAYS_NONE)
    call = [sys.executable, "-m", "wrenchbed", "blind", "run", str(cases), "--out"]
    call += [str(tmp_path / "claims"), "--method", slow]
    process = subprocess.Popen(call)
    folder = tmp_path / "claims" / Entrant.of(slow).name
    give_up = time.monotonic() + 60
    while len(list(folder.glob("0*"))) < 4 and time.monotonic() < give_up:
        time.sleep(0.05)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    time.sleep(2.0)  # its workers notice
    kept = {p.parent.name: p.stat().st_mtime_ns for p in folder.glob("0*/run.json")}
    time.sleep(1.0)
    assert len(list(folder.glob("0*/run.json"))) == len(kept), "workers outlived the run"
    assert 4 <= len(kept) < COUNT
    assert main(call[3:]) == 0
    after = {p.parent.name: p.stat().st_mtime_ns for p in folder.glob("0*/run.json")}
    assert len(after) == COUNT
    assert all(after[k] == v for k, v in kept.items())


# ---- the score -----------------------------------------------------------------------------------


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
    found = report.summary(scoring.score(cases, tmp_path / "claims", answers, "knows"))
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
    told = report.summary(scoring.score(cases, tmp_path / "claims", answers))["me"]
    assert told["isolation_alike"]["value"] == 1.0
    assert told["isolation_unlike"]["value"] == 1.0
    assert told["isolation"]["value"] < 1.0


def test_numbers_are_held_against_true_ones(family, tmp_path):
    cases, answers, _ = family
    truthful(cases, answers, tmp_path / "claims" / "me")
    changed = 0
    for name in seal.read(cases):
        truth = answer.read(seal.answer_of(answers, name))
        path = tmp_path / "claims" / "me" / name / CLAIM
        told = json.loads(path.read_bytes())
        for cause, said in zip(truth.causes, told["which"], strict=False):
            if cause.effect in scoring.COMPARED and cause.effect != "joint.compliance":
                said["parameters"] = {k: {"value": v, "std": 1e-9} for k, v in cause.true.items()}
                changed += 1
        path.write_text(json.dumps(told))
    found = scoring.score(cases, tmp_path / "claims", answers)
    assert changed > 2
    assert report.summary(found)["me"]["coverage"]["value"] == 1.0


def test_the_verbs_make_and_score(tmp_path, capsys, monkeypatch, family):
    cases, answers, root = family
    truthful(cases, answers, tmp_path / "claims" / "me")
    line = ["blind", "score", str(cases), str(tmp_path / "claims"), str(answers)]
    assert main([*line, "--out", str(tmp_path / "page")]) == 0
    assert root in capsys.readouterr().out.replace("\n", "")
    page = (tmp_path / "page" / "score.md").read_text()
    assert "Reliability" in page and "Wrong first answers" in page
    assert (tmp_path / "page" / "score.html").read_text().count("<svg") == 2
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
        tell=lambda n, *_: told.append(n),
    )
    assert again == root
    assert told == [COUNT]
    assert making.drawn_seed() != making.drawn_seed()


def test_probabilities_beside_how_often_they_hold(family, tmp_path):
    cases, answers, _ = family
    truthful(cases, answers, tmp_path / "claims" / "me")
    found = report.page(scoring.score(cases, tmp_path / "claims", answers))
    tables = [p for s in found.sections for p in s.parts if hasattr(p, "rows")]
    assert np.all([len(t.rows) > 0 for t in tables[:-1]])
    assert len(tables[-1].rows) == 0  # no wrong answers


# ---- real cases ----------------------------------------------------------------------------------


TRUTH = """
[[case]]
recording = "tilted.parquet"
kind = "single"
[[case.cause]]
effect = "base.tilt"
true = { x = 0.0087, y = 0.0, a.b = 1.0 }

[[case]]
recording = "plain.parquet"
kind = "none"
"""


@pytest.fixture
def measured(family, tmp_path):
    """Two recordings whose columns and metadata tell more than they should."""
    cases, _, _ = family
    for name, source in (("tilted", "0001"), ("plain", "0002")):
        data = Recording.read(seal.recording_of(cases, source))
        columns = dict(data.columns) | {"shim": data.t * 0.0 + 3.0}
        extra = {"operator": "put a shim under the base"}
        meta = type(data.metadata)(**{**vars(data.metadata), "extra": extra})
        Recording(meta, columns, name).write(tmp_path / f"{name}.parquet")
    (tmp_path / "truth.toml").write_text(TRUTH)
    return tmp_path


def test_real_recordings_are_sealed_under_numbers_and_scored(measured, capsys):
    line = ["blind", "seal", str(measured / "truth.toml"), "--out", str(measured / "c")]
    assert main([*line, "--answers", str(measured / "a"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["commitments"]
    sealed = seal.verify(measured / "c", measured / "a")
    assert list(sealed) == ["0001", "0002"]
    for name in sealed:
        found = Recording.read(seal.recording_of(measured / "c", name))
        assert "shim" not in found.columns
        assert found.metadata.extra == {} and found.metadata.source is None
    truthful(measured / "c", measured / "a", measured / "claims" / "me")
    score = scoring.score(measured / "c", measured / "claims", measured / "a")
    told = report.summary(score)
    assert told["me"]["isolation"]["value"] == 1.0
    assert "oracle" not in told
    assert "nan" not in report.page(score).markdown()
    truths = {a.effects: a.causes for a in score.answers.values()}
    assert truths[("base.tilt",)][0].true == {"x": 0.0087, "y": 0.0, "a.b": 1.0}


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"base.tilt"', '"base.tlit"', "base.tlit"),
        ('kind = "single"', 'kind = "pair"', r"has 2 \[\[case.cause\]\], found 1"),
        ('kind = "none"', 'kind = "fine"', "case 2: kind = 'fine'"),
        ('"plain.parquet"', '"gone.parquet"', "no such file"),
        ("x = 0.0087", 'x = "0.5 deg"', "table of numbers"),
        ("[[case.cause]]", "[case.cause]", "double brackets"),
        ("[[case]]", "[[cases]]", "no .*case"),
        ("kind =", "kind", "not valid TOML"),
    ],
)
def test_a_truth_that_is_wrong_is_named(measured, capsys, old, new, said):
    path = measured / "truth.toml"
    path.write_text(path.read_text().replace(old, new))
    line = ["blind", "seal", str(path), "--out", str(measured / "c")]
    assert main([*line, "--answers", str(measured / "a")]) == 1
    import re

    assert re.search(said, capsys.readouterr().err.replace("\n", " "))
    assert not (measured / "c" / seal.COMMITMENTS).exists()
