"""No two statements of a diagnosis contradict each other, whatever happened to the recording."""

import warnings

import pytest

import consistent
import mutated

SAMPLE = (4, 21, 23, 38, 50, 505, 561)
"""Cases for every run: `scripts/invariants` does thousands."""
MANY = range(300)


def judged(seed):
    case = mutated.case(seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        _, found = consistent.outcome(case.recording)
    assert not found, f"{case}: {found}"


@pytest.mark.parametrize("seed", SAMPLE)
def test_no_answer_contradicts_itself(seed):
    judged(seed)


@pytest.mark.study
@pytest.mark.parametrize("seed", MANY)
def test_no_answer_of_many_contradicts_itself(seed):
    judged(seed)


def test_a_case_follows_from_its_seed():
    one, again = mutated.case(7), mutated.case(7)
    assert str(one) == str(again)
    assert (one.recording.wrench == again.recording.wrench).all()
    assert len(mutated.MUTATORS) >= 40
