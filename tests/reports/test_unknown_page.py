"""A diagnosis that is really unknown: a fault that other code made and no effect of the library."""

import pytest

import consistent
from wrenchbed.benchmark.referee.case import make
from wrenchbed.diagnosis.diagnose import Findings, diagnose
from wrenchbed.pages import numbers


@pytest.fixture(scope="module")
def found() -> Findings:
    """Readings that drop out now and then, and a hundred small imperfections."""
    case = make("ur5", "static", "outside", (41, 3))
    assert case.causes[0].fault.name == "dropout"
    return diagnose(case.recording)


@pytest.mark.slow
def test_page_terminal_json_and_rerun_say_that_it_is_unknown(found):
    told = found.diagnosis.to_json()
    assert told["verdict"] == "unknown" and told["which"] == []
    assert consistent.violations(found) == []
    faces = consistent.faces(found)
    assert set(faces) == {"page", "terminal", "rerun"}
    gap = numbers.gap(told["gap"]["calibrated"])
    for name, text in faces.items():
        assert "unknown" in text and gap in text, name
        for step in told["next"]:
            assert step["sentence"] in text, name
