"""A small sealed family, one who knows its answers, and programs that enter."""

import json
import sys

import pytest

from wrenchbed.benchmark.referee import scenario as settings
from wrenchbed.benchmark.scoring.truth_and_claims import Claim
from wrenchbed.benchmark.sealed import commitments, make
from wrenchbed.benchmark.sealed.run import CLAIM, RUN, contract

COUNT, SEED = 16, 20


def small(patch):
    """Robots with few poses and rows."""
    patch.setattr(settings, "POSES", (12, 14))
    patch.setattr(settings, "SAMPLES", 6)


def made(folder):
    """Cases and answers, made in this process, and the SHA-256 of the commitments."""
    patch = pytest.MonkeyPatch()
    small(patch)
    cases, answers = folder / "cases", folder / "answers"
    told = make.Family("ur5", "static", COUNT, SEED)
    make.open_family(told, cases, answers)
    for index in range(COUNT):
        make.make_case(told, cases, answers, index)
    root = make.make(told, cases, answers)  # nothing is left but to commit
    patch.undo()
    return cases, answers, root


def truthful(cases, answers, folder, twist=lambda truth, claim: claim):
    """Claims of one who knows."""
    for name in commitments.read(cases):
        truth = commitments.read_answer(commitments.answer_of(answers, name))
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


def script(tmp_path, body):
    path = tmp_path / "method.py"
    path.write_text("import json, os, sys, time\nout = sys.argv[3]\n" + body)
    return f"{sys.executable} {path}"


SAYS_NONE = """
told = {"format": 1, "verdict": "none", "which": [], "probabilities": {"none": 1.0}}
open(os.path.join(out, "diagnosis.json"), "w").write(json.dumps(told))
"""
