"""What is sealed stays sealed, and leaks nothing."""

import json
import os
from pathlib import Path
from runpy import run_path

import pytest

from sealed_family import COUNT, SEED, small, truthful
from wrenchbed.benchmark.sealed import commitments, make, score
from wrenchbed.data.recording import Recording
from wrenchbed.errors import BenchmarkError, ParameterError


@pytest.fixture(scope="module")
def attack():
    return run_path(str(Path(__file__).parents[2] / "scripts" / "attack_sealed"))["attack"]


def test_shares_of_kinds_are_as_promised():
    kinds = make.Family("ur5", "static", 300, 1).kinds()
    count = {k: kinds.count(k) for k in set(kinds)}
    assert count == {"none": 75, "single": 120, "pair": 45, "outside": 60}
    assert kinds != sorted(kinds)
    assert make.Family("ur5", "static", 300, 2).kinds() != kinds


def test_cases_hold_recordings_and_commitments_only(family):
    cases, answers, root = family
    assert len(list(cases.iterdir())) == COUNT + 1
    assert commitments.digest((cases / commitments.COMMITMENTS).read_bytes()) == root
    assert len(commitments.verify(cases, answers)) == COUNT
    data = Recording.read(commitments.recording_of(cases, "0001"))
    assert data.metadata.extra == {}
    text = (cases / commitments.COMMITMENTS).read_text()
    assert "salt" not in text and "effect" not in text
    assert {p.stat().st_mtime for p in cases.iterdir()} == {commitments.EPOCH}
    salts = {commitments.read_answer(p).salt for p in answers.glob("0*.json")}
    assert len(salts) == COUNT and all(len(s) == 64 for s in salts)


def test_the_same_seed_makes_the_same_bytes(family, tmp_path, monkeypatch):
    cases, answers, _ = family
    small(monkeypatch)
    told = make.Family("ur5", "static", COUNT, SEED)
    make.open_family(told, tmp_path / "c", tmp_path / "a")
    make.make_case(told, tmp_path / "c", tmp_path / "a", 2)
    for folder, other, file in ((cases, "c", "0003.parquet"), (answers, "a", "0003.json")):
        assert (folder / file).read_bytes() == (tmp_path / other / file).read_bytes()


@pytest.mark.parametrize("which", ["recording", "answer", "commitments", "root"])
def test_what_was_tampered_with_is_refused(copied, which, tmp_path):
    cases, answers = copied
    truthful(cases, answers, tmp_path / "claims" / "me")
    score.score(cases, tmp_path / "claims", answers)
    path = {
        "recording": commitments.recording_of(cases, "0002"),
        "answer": commitments.answer_of(answers, "0002"),
        "commitments": cases / commitments.COMMITMENTS,
        "root": answers / commitments.FAMILY,
    }[which]
    data = bytearray(path.read_bytes())
    if which == "answer":
        data = bytearray(bytes(data).replace(b'"minor": 0', b'"minor": 1', 1))
    elif which == "root":
        data = bytearray(json.dumps(json.loads(data) | {"commitments": "0" * 64}).encode())
    elif which == "commitments":  # of a case and its commitment together
        recording = commitments.recording_of(cases, "0002")
        recording.write_bytes(recording.read_bytes() + b" ")
        told = json.loads(data)
        told["cases"]["0002"]["recording"] = commitments.digest(recording.read_bytes())
        data = bytearray((json.dumps(told, indent=1) + "\n").encode())
    else:
        data[len(data) // 2] ^= 1
    path.write_bytes(bytes(data))
    with pytest.raises(BenchmarkError, match="was changed"):
        score.score(cases, tmp_path / "claims", answers)


def test_what_was_sealed_is_not_sealed_again(copied):
    cases, answers = copied
    told = make.Family("ur5", "static", COUNT, SEED)
    root = make.make(told, cases, answers)
    assert make.resumed(answers) == SEED and make.resumed(cases) is None
    path = commitments.answer_of(answers, "0003")
    path.write_bytes(path.read_bytes().replace(b'"minor": 0', b'"minor": 1', 1))
    with pytest.raises(BenchmarkError, match=r"0003\.json: was changed"):
        make.make(told, cases, answers)
    assert commitments.digest((cases / commitments.COMMITMENTS).read_bytes()) == root


def test_all_files_together_cannot_be_changed_behind_what_was_published(copied, tmp_path):
    cases, answers = copied
    truthful(cases, answers, tmp_path / "claims" / "me")
    root = commitments.digest((cases / commitments.COMMITMENTS).read_bytes())
    score.score(cases, tmp_path / "claims", answers, published=root)
    told = json.loads((cases / commitments.COMMITMENTS).read_bytes())
    path = commitments.answer_of(answers, "0003")
    path.write_bytes(path.read_bytes().replace(b'"minor": 0', b'"minor": 1', 1))
    told["cases"]["0003"]["answer"] = commitments.digest(path.read_bytes())
    text = json.dumps(told).encode()
    (cases / commitments.COMMITMENTS).write_bytes(text)
    family = json.loads((answers / commitments.FAMILY).read_bytes()) | {
        "commitments": commitments.digest(text)
    }
    (answers / commitments.FAMILY).write_text(json.dumps(family))
    score.score(cases, tmp_path / "claims", answers)  # nobody could tell
    with pytest.raises(BenchmarkError, match="what was published"):
        score.score(cases, tmp_path / "claims", answers, published=root)


def test_paths_as_names_and_missing_answers_are_refused(copied, tmp_path):
    cases, answers = copied
    truthful(cases, answers, tmp_path / "claims" / "me")
    commitments.answer_of(answers, "0005").unlink()
    with pytest.raises(BenchmarkError, match=r"0005\.json: is missing"):
        score.score(cases, tmp_path / "claims", answers)
    cases, _ = copied
    told = json.loads((cases / commitments.COMMITMENTS).read_bytes())
    told["cases"]["../../x"] = told["cases"]["0001"]
    (cases / commitments.COMMITMENTS).write_text(json.dumps(told))
    with pytest.raises(BenchmarkError, match="no name of a case"):
        commitments.read(cases)


def test_answers_are_for_their_owner_alone(family):
    assert family[1].stat().st_mode & 0o777 == 0o700


def test_answers_lie_apart_and_families_do_not_mix(tmp_path, family):
    cases, answers, _ = family
    told = make.Family("ur5", "static", 2, 1)
    for where in (tmp_path, tmp_path / "inside"):
        with pytest.raises(BenchmarkError, match="apart"):
            make.make(told, tmp_path, where)
    with pytest.raises(BenchmarkError, match="belongs to a run with cases"):
        make.make(told, cases, answers)
    (tmp_path / "x").mkdir()
    (tmp_path / "x" / "notes.txt").write_text("mine")
    with pytest.raises(BenchmarkError, match=r"notes\.txt"):
        make.make(told, tmp_path / "x", tmp_path / "y")
    with pytest.raises(ParameterError, match="empty"):
        make.Family("ur5", "static", 0, 1)


def test_nothing_but_wrench_and_joints_tells_the_answer(family, attack):
    cases, answers, _ = family
    for found in attack(cases, answers):
        assert found.p_value > 0.01, found
        assert abs(found.accuracy - found.chance) < 0.3, found


def test_the_attack_finds_a_leak(copied, attack):
    cases, answers = copied
    for name in commitments.read(cases):
        kind = commitments.read_answer(commitments.answer_of(answers, name)).kind
        path = commitments.recording_of(cases, name)
        when = commitments.EPOCH + 1000 * ("none", "single", "pair", "outside").index(kind)
        os.utime(path, (when, when))
        data = Recording.read(path)
        columns = dict(data.columns) | {kind: data.t}
        commitments.write_recording(Recording(data.metadata, columns, name), path)
        os.utime(path, (when, when))
    assert attack(cases, answers)[0].p_value < 0.05
