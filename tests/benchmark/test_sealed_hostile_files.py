"""Robots' and cases' text files from others stay within limits of size and depth."""

import json

import pytest

from sealed_family import SAYS_NONE, script
from wrenchbed.benchmark.sealed import commitments, make, run, score
from wrenchbed.benchmark.sealed.run import CLAIM, RUN, Entrant
from wrenchbed.errors import BenchmarkError, ParameterError
from wrenchbed.jobs.parts import Journal, check_folders
from wrenchbed.robots.described import read as read_robot
from wrenchbed.sensors.described import read as read_sensor

DEEP = "[" * 200_000 + "]" * 200_000
TOML = {
    "long": ("#" * (2**20 + 1), "longer than 1,048,576 bytes"),
    "dots": ("a." * 300 + "b = 1", "more than 200 dots"),
    "deep": ("a = " + "[" * 150 + "]" * 150, "nested more than 100 levels"),
    "very deep": ("a = " + DEEP, "nested more than 100 levels"),
}


@pytest.mark.parametrize("reads", [read_robot, read_sensor], ids=["robot", "sensor"])
@pytest.mark.parametrize("what", TOML)
def test_a_robot_or_sensor_of_others_is_refused_beyond_the_limits(reads, what, tmp_path):
    text, told = TOML[what]
    path = tmp_path / "my.toml"
    path.write_text(text)
    with pytest.raises(ParameterError, match=told) as caught:
        reads(path)
    assert len(str(caught.value).splitlines()) == 1
    assert str(path) in str(caught.value)


def test_files_of_a_sealed_benchmark_are_refused_where_they_are_too_deep(tmp_path):
    (tmp_path / "answers").mkdir()
    for name in (commitments.COMMITMENTS, "0001.json", f"answers/{commitments.FAMILY}"):
        (tmp_path / name).write_text(DEEP)
    with pytest.raises(BenchmarkError, match="nested more than 100 levels"):
        commitments.read(tmp_path)
    with pytest.raises(BenchmarkError, match="nested more than 100 levels"):
        commitments.read_answer(tmp_path / "0001.json")
    assert make.resumed(tmp_path / "answers") is None
    with pytest.raises(BenchmarkError, match="nested more than 100 levels"):
        check_folders(tmp_path / "0001.json", {"a": 1}, (tmp_path,), BenchmarkError)


def test_a_claim_too_deep_or_too_long_is_a_wrong_answer(tmp_path):
    for text, why in ((DEEP, "nested more than"), (" " * (2**25 + 1), "longer than")):
        (tmp_path / CLAIM).write_text(text)
        assert why in score.read(tmp_path).error
    (tmp_path / RUN).write_text(DEEP)
    assert "is broken" in score.read(tmp_path).error


def test_an_answered_case_too_deep_is_named(family, tmp_path):
    cases, _, _ = family
    folder = tmp_path / "claims" / "me" / "0001"
    folder.mkdir(parents=True)
    (folder / RUN).write_text(DEEP)
    with pytest.raises(BenchmarkError, match=r"0001.*nested more than 100 levels"):
        run.run(cases, tmp_path / "claims", [Entrant("me", script(tmp_path, SAYS_NONE))])


def test_a_journal_leaves_out_a_line_that_is_too_deep(tmp_path):
    path = tmp_path / "rows.jsonl"
    path.write_text(json.dumps({"index": 0}) + "\n" + DEEP + "\n")
    assert Journal(path).read() == [{"index": 0}]
