"""No two statements of a diagnosis contradict each other, whatever happened to the recording."""

import warnings

import pytest

import consistent
import mutated
from wrenchbed.benchmark.sealed.make import EffortFamily, Family

SAMPLE = (15, 1, 2, 4, 5, 6, 14, 16, 780057, 790081)
CASES, SEED = 60, 4545
FAMILIES = {
    "rest": Family("ur5", "static", CASES, SEED),
    "motion": Family("ur5", "dynamic", CASES, SEED),
    "loops": Family("medrue", "static", CASES, SEED),
    "efforts": EffortFamily("ur5", "dynamic", CASES, SEED),
    "both": EffortFamily("ur5", "dynamic", CASES, SEED, wrench=True),
}
EVERY = [
    pytest.param(f, k, marks=pytest.mark.study if k else ()) for f in FAMILIES for k in range(CASES)
]


@pytest.mark.sampled
@pytest.mark.parametrize("seed", SAMPLE)
def test_no_answer_contradicts_itself(seed):
    case = mutated.case(seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        _, found = consistent.outcome(case.recording)
    assert not found, f"{case}: {found}"


@pytest.mark.slow
@pytest.mark.parametrize(("family", "case"), EVERY)
def test_page_terminal_json_and_rerun_say_the_same(family, case):
    _, recording = FAMILIES[family].found(case)
    assert consistent.outcome(recording)[1] == []
