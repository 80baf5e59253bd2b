"""Cases of one plan: a robot that nothing was learnt on is learnt once for all of them."""

import json
from dataclasses import replace

import numpy as np
import pytest

from sealed_family import small, truthful
from wrenchbed import registry
from wrenchbed.benchmark.sealed import commitments, report, run, score
from wrenchbed.benchmark.sealed.run import CLAIM
from wrenchbed.cli import main
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.explain.reliability import shipped

CASES = 2


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    """Cases and answers at the poses of one plan, by the command line."""
    patch = pytest.MonkeyPatch()
    small(patch)
    folder = tmp_path_factory.mktemp("planned")
    robot = registry.load("robots", "ur5")
    Plan.of("ur5", robot.sample(12, np.random.default_rng(4))).write(folder / "poses.parquet")
    line = ["blind", "make", "--plan", str(folder / "poses.parquet"), "--cases", str(CASES),
            "--seed", "3", "--processes", "1", "--out", str(folder / "cases"),
            "--answers", str(folder / "answers")]  # fmt: skip
    assert main(line) == 0
    patch.undo()
    return folder


def _recordings(cases):
    return [
        Recording.read(commitments.recording_of(cases / "cases", f"{k:04d}"))
        for k in range(1, CASES + 1)
    ]


@pytest.mark.slow
def test_all_cases_rest_at_the_poses_of_the_plan_with_one_stated_tool(cases):
    wanted = Plan.read(cases / "poses.parquet").q
    told = _recordings(cases)
    for recording in told:
        poses = np.array(
            [recording.q[recording.columns["segment"] == k].mean(axis=0) for k in range(12)]
        )
        assert np.abs(poses - wanted).max() < 1e-4  # encoders have noise
        assert recording.metadata.to_json() == told[0].metadata.to_json()
    assert np.abs(told[0].wrench - told[1].wrench).max() > 0.0
    family = json.loads((cases / "answers" / commitments.FAMILY).read_bytes())
    assert family["plan"] == commitments.digest((cases / "poses.parquet").read_bytes())


@pytest.mark.slow
def test_the_diagnosis_gets_what_was_learnt_once(cases, tmp_path, monkeypatch):
    asked, given = [], []

    def learn(recording, count, **_):
        asked.append((recording.name, count))
        return replace(shipped("ur5", False), source="look-alikes", own=True)

    def diagnose(recording, reliability=None):
        given.append(reliability)
        raise RuntimeError("not needed here")

    monkeypatch.setattr(run, "reliability_at_design", learn)
    monkeypatch.setattr(run, "diagnose", diagnose)
    monkeypatch.setattr("wrenchbed.benchmark.sealed.run.in_workers", _here)
    line = ["blind", "run", str(cases / "cases"), "--out", str(tmp_path / "claims"), "--method",
            "diagnose", "--look-alikes", "50"]  # fmt: skip
    assert main(line) == 0
    assert [count for _, count in asked] == [50]
    assert [r.source for r in given] == ["look-alikes"] * CASES


def _here(work, todo, finished, processes, *rest):
    from concurrent.futures import Future

    for item in todo:
        future = Future()
        future.set_result(work(item))
        finished(item, future)


def test_cases_of_several_plans_cannot_be_learnt_together(family, tmp_path, capsys):
    line = ["blind", "run", str(family[0]), "--out", str(tmp_path / "claims"), "--method",
            "diagnose", "--look-alikes", "50"]  # fmt: skip
    assert main(line) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "0002.parquet: its poses or its stated numbers are not those of 0001.parquet" in said
    assert "--plan" in said


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (["--robot", "medrue"], "is a plan for 'ur5', not for 'medrue'"),
        (["--mode", "dynamic"], "--plan is of poses"),
    ],
)
def test_a_plan_of_something_else_is_refused(cases, tmp_path, capsys, change, said):
    line = ["blind", "make", "--plan", str(cases / "poses.parquet"), "--cases", "1", "--out",
            str(tmp_path / "c"), "--answers", str(tmp_path / "a"), *change]  # fmt: skip
    assert main(line) == 1
    assert said in " ".join(capsys.readouterr().err.split())


def test_a_motion_is_no_plan_of_poses(tmp_path, capsys):
    home = registry.load("robots", "ur5").home
    path = tmp_path / "motion.parquet"
    Plan.of("ur5", np.repeat(home[None], 5, axis=0), rate_hz=100.0).write(path)
    line = ["blind", "make", "--plan", str(path), "--cases", "1", "--out", str(tmp_path / "c"),
            "--answers", str(tmp_path / "a")]  # fmt: skip
    assert main(line) == 1
    assert "is a motion" in capsys.readouterr().err


def test_sets_of_answers_count_where_they_hold_the_truth(family, tmp_path):
    cases, answers, _ = family
    for who, right in (("right", True), ("wrong", False)):
        truthful(cases, answers, tmp_path / "claims" / who)
        for name in commitments.read(cases):
            truth = commitments.read_answer(commitments.answer_of(answers, name))
            path = tmp_path / "claims" / who / name / CLAIM
            told = json.loads(path.read_bytes())
            own = truth.effects[-1:] or ("unknown" if truth.kind == "outside" else "none",)
            told["set90"] = ["sensor.bias", *own] if right else ["nothing"]
            path.write_text(json.dumps(told))
    for who, expected in (("right", 1.0), ("wrong", 0.0)):
        found = report.summary(score.score(cases, tmp_path / "claims", answers, who))
        assert found[who]["sets"]["value"] == expected
        assert found[who]["sets"]["n"] == len(commitments.read(cases))
