"""No two statements of a diagnosis contradict each other, whatever happened to the recording."""

import warnings

import pytest

import consistent
import mutated

SAMPLE = (15, 1, 2, 4, 5, 6, 14, 16, 780057, 790081)
"""Cases for every run: `scripts/invariants` does thousands."""


@pytest.mark.sampled
@pytest.mark.parametrize("seed", SAMPLE)
def test_no_answer_contradicts_itself(seed):
    case = mutated.case(seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        _, found = consistent.outcome(case.recording)
    assert not found, f"{case}: {found}"
