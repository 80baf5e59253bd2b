"""Any program may enter, and is held to the contract."""

import json
import time

import pyarrow.parquet as pq
import pytest

from sealed_family import COUNT, SAYS_NONE, script
from wrenchbed.benchmark.referee import scenario as settings
from wrenchbed.benchmark.scoring.case_rows import Claim
from wrenchbed.benchmark.sealed import make, report, run, score
from wrenchbed.benchmark.sealed import score as claims
from wrenchbed.benchmark.sealed.run import CLAIM, RUN, Entrant, contract, enter
from wrenchbed.effects.chain import effects
from wrenchbed.errors import BenchmarkError, ParameterError


@pytest.mark.slow
def test_any_program_may_enter_and_goes_on_after_a_stop(family, tmp_path):
    cases, answers, _ = family
    entrant = Entrant("says-none", script(tmp_path, SAYS_NONE))
    assert run.run(cases, tmp_path / "claims", [entrant]) == {"says-none": 0}
    told = []
    run.run(cases, tmp_path / "claims", [entrant], report=lambda n, *_: told.append(n))
    assert told == [COUNT]  # all were there
    found = score.score(cases, tmp_path / "claims", answers)
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
    assert enter(cases, tmp_path / "claims", 1.0, ("0001", [entrant])) == ["broken"]
    assert time.monotonic() - begun < 20
    found = claims.read(tmp_path / "claims" / "broken" / "0001")
    assert found.claim.verdict == "error"
    assert said in found.error
    rows = score.score(cases, tmp_path / "claims", answers).rows
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
    assert effects()["joint.compliance"].amplitudes(found.parameters["joint.compliance"]) is None


def test_a_claim_belongs_to_one_case(family, tmp_path):
    cases, answers, _ = family
    entrant = Entrant("me", script(tmp_path, SAYS_NONE))
    assert enter(cases, tmp_path / "claims", 20.0, ("0001", [entrant])) == []
    (tmp_path / "claims" / "me" / "0001").rename(tmp_path / "claims" / "me" / "0002")
    with pytest.raises(BenchmarkError, match="another family"):
        run.run(cases, tmp_path / "claims", [entrant])
    found = score.score(cases, tmp_path / "claims", answers)
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
    assert enter(cases, tmp_path / "claims", 20.0, ("0001", [entrant])) == ["me"]
    messy = Entrant(
        "you", script(tmp_path, "os.makedirs(os.path.join(out, 'a', 'b'))\n" + SAYS_NONE)
    )
    for _ in range(2):
        assert enter(cases, tmp_path / "claims", 20.0, ("0001", [messy])) == []


@pytest.mark.slow
def test_our_own_methods_answer_a_case(tmp_path, monkeypatch):
    monkeypatch.setattr(settings, "POSES", (24, 24))
    monkeypatch.setattr(settings, "SAMPLES", 10)
    cases, answers = tmp_path / "cases", tmp_path / "answers"
    told = make.Family("ur5", "static", 1, 3)
    make.open_family(told, cases, answers)
    make.make_case(told, cases, answers, 0)
    make.make(told, cases, answers)
    entrants = [Entrant.of(m) for m in ("bic", "diagnose", "none")]
    assert enter(cases, tmp_path / "claims", 120.0, ("0001", entrants)) == []
    for entrant in entrants:
        assert claims.read(tmp_path / "claims" / entrant.name / "0001").error == ""
    assert enter(cases, tmp_path / "claims", 0.01, ("0001", entrants[1:2])) == ["diagnose"]
    found = claims.read(tmp_path / "claims" / "diagnose" / "0001")
    assert "longer than" in found.error


def test_an_entrant_whose_time_ends_while_it_reads_is_over_time(family, tmp_path, monkeypatch):
    def slow(*_, **__):
        time.sleep(5.0)

    monkeypatch.setattr(pq.ParquetFile, "read", slow)
    cases, _, _ = family
    assert enter(cases, tmp_path, 0.1, ("0001", [Entrant.of("none")])) == ["none"]
    assert "longer than" in claims.read(tmp_path / "none" / "0001").error


DEEP = "[" * 200_000 + "]" * 200_000


def test_a_claim_too_deep_or_too_long_is_a_wrong_answer(tmp_path):
    for text, why in ((DEEP, "nested more than"), (" " * (2**25 + 1), "longer than")):
        (tmp_path / CLAIM).write_text(text)
        assert why in score.read(tmp_path).error
    (tmp_path / RUN).write_text(DEEP)
    assert "is broken" in score.read(tmp_path).error
