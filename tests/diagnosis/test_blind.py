"""What a recording could not have shown: sizes that such recordings report 95 times in 100."""

import numpy as np
import pytest

from wrenchbed import registry
from wrenchbed.data.plan import Plan
from wrenchbed.diagnosis.evidence.dictionary import build
from wrenchbed.diagnosis.evidence.search import NONE, PRIOR, Searcher
from wrenchbed.diagnosis.evidence.similarity import Similarity
from wrenchbed.diagnosis.next.blind import (
    DETECTED,
    LEAST_MINOR,
    ORDINARY,
    BlindSpot,
    Design,
    sentences,
)
from wrenchbed.diagnosis.next.dry_run import dry_run, of_plan
from wrenchbed.diagnosis.prepare.baseline import tolerances

DRAWS = 400


def plan(n, seed=1):
    robot = registry.load("robots", "ur5")
    return Plan.of("ur5", robot.sample(n, np.random.default_rng(seed)))


@pytest.fixture(scope="module")
def design():
    prepared = of_plan(plan(30), samples=20)
    d = build(prepared, prepared.configuration.robot_theta, tolerances(prepared))
    return Design(Similarity(d), Searcher(d), 1)


@pytest.mark.parametrize(
    ("effect", "label"),
    [("joint.offset", "joint 5"), ("link.length", "alpha2"), ("base.tilt", "about x and y")],
)
def test_a_fault_of_that_size_is_reported_in_95_of_100_draws(design, effect, label):
    """Noise, background, imperfections of the effect and fault are drawn from the model."""
    signatures, d, searcher = design.similarity.signatures, design.similarity.d, design.searcher
    (at,) = (k for k, w in enumerate(signatures) if (w.name, w.variant.label) == (effect, label))
    places = [k for k, h in enumerate(searcher.hypotheses) if h.name == effect]
    (place,) = (k for k in places if searcher.hypotheses[k].variant.label == label)
    h, level = searcher.hypotheses[place], searcher.rungs[design.rung].level
    rng = np.random.default_rng(2)
    size = rng.standard_normal((len(h.columns), DRAWS))
    size *= design.sizes[at] * np.sqrt(len(size)) / np.linalg.norm(size, axis=0)
    size += ORDINARY * rng.standard_normal(size.shape)
    imperfect = np.sqrt(level.V)[:, None] * rng.standard_normal((len(level.V), DRAWS))
    noise = np.sqrt(level.v0)[:, None] * rng.standard_normal((len(level.v0), DRAWS))
    scores, nulls = level.scored(d.E @ imperfect + noise + d.E[:, h.columns] @ size)
    fitted = np.linalg.solve(level.information(h.columns[None])[0], scores[h.columns])
    reported = []
    for score, null, x in zip(scores.T, nulls.tolist(), fitted.T, strict=True):
        singles = searcher.added(design.rung, null, score)
        odds = next(s.log_posterior for s in singles if s.index == place) - null
        there = odds - np.log(PRIOR[NONE]) > np.log(DETECTED / (1.0 - DETECTED))
        reported.append(there and d.gap(d.E[:, h.columns] @ x) >= LEAST_MINOR)
    assert 0.92 < np.mean(reported) < 0.98


def test_more_imperfections_hide_more(design):
    least, more = design.sizes, Design(design.similarity, design.searcher, 2).sizes
    shown = np.isfinite(least) & (least > 1e-3)  # below, ordinary imperfections are reported
    assert 0.5 < shown.mean() < 1.0 and np.array_equal(np.isfinite(least), np.isfinite(more))
    assert (more >= least)[shown].mean() > 0.9 and np.median(more[shown] / least[shown]) > 1.01


def test_a_plan_of_fewer_rows_is_blind_to_more():
    few, many = (dry_run(plan(20), samples=n).blind for n in (2, 60))
    sizes = [{(b.effect, b.element): b.smallest for b in blind} for blind in (few, many)]
    assert len(few) >= len(many)
    assert ("joint.offset", "joint 1") in sizes[1] and ("joint.offset", "joint 2") not in sizes[1]
    both = [(sizes[0][k], s) for k, s in sizes[1].items() if s and sizes[0].get(k)]
    assert len(both) > 20 and np.mean([a > b for a, b in both]) > 0.9


def test_sentences_group_elements():
    spots = [
        BlindSpot("link.length", "alpha2", 0.002, "rad"),
        BlindSpot("link.length", "alpha3", 0.003, "rad"),
        BlindSpot("link.length", "a2", None, ""),
    ]
    assert sentences(spots) == (
        "link.length of a2: no effect on these readings",
        "link.length of alpha2 and alpha3: seen from 0.11° to 0.17°",
    )
