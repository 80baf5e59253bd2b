"""No two statements of a diagnosis contradict each other, whatever happened to the recording."""

import warnings

import pytest

import consistent
import mutated
from simulated import UR5_TRUTH, WHITE, static
from wrenchbed.diagnosis.diagnose import diagnose
from wrenchbed.pages import numbers
from wrenchbed.reports.wrench_answer import WrenchAnswer

SAMPLE = (15, 1, 2, 4, 5, 6, 14, 16)
"""Cases for every run: `scripts/invariants` does thousands."""


@pytest.mark.sampled
@pytest.mark.parametrize("seed", SAMPLE)
def test_no_answer_contradicts_itself(seed):
    case = mutated.case(seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        _, found = consistent.outcome(case.recording)
    assert not found, f"{case}: {found}"


@pytest.fixture(scope="module")
def judged():
    """A diagnosis that claims something, and what people read of it."""
    found = diagnose(static("ur5", UR5_TRUTH, poses=24, samples=6, noise=0.3 * WHITE, seed=3))
    texts = consistent.faces(found)
    assert found.diagnosis.which and not consistent.violations_of(found, texts)
    return found, texts


@pytest.mark.parametrize("face", ["terminal", "page", "rerun"])
@pytest.mark.parametrize("what", ["verdict", "value", "gap", "place", "unit", "number"])
def test_a_face_that_says_something_else_is_caught(judged, face, what):
    found, texts = judged
    d, place = found.diagnosis, WrenchAnswer(found).place
    (name, size), *_ = d.which[0]["parameters"].items()
    was, now = {
        "verdict": (d.verdict, "none"),
        "value": (consistent.flat(numbers.quantity(name, size)), "7 N"),
        "gap": (f"calibrated {numbers.gap(d.gap.calibrated.value)}", "calibrated 0.01"),
        "place": (place, "No place differs from noise"),
        "unit": (place, f"{place} 0.003 rad"),
        "number": (place, f"{place} nan"),
    }[what]
    assert was in texts[face]
    assert consistent.violations_of(found, texts | {face: texts[face].replace(was, now)})


def test_a_case_follows_from_its_seed():
    one, again = mutated.case(7), mutated.case(7)
    assert str(one) == str(again)
    assert (one.recording.wrench == again.recording.wrench).all()
    assert len(mutated.MUTATORS) >= 40
