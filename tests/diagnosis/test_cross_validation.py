"""The second vote is the exact predictive density."""

import numpy as np
import pytest

from wrenchbed.diagnosis.evidence.likelihood import BackgroundLevel
from wrenchbed.diagnosis.explain.finalist import Finalist
from wrenchbed.diagnosis.explain.structures import prediction_errors


@pytest.mark.parametrize("columns", [5, 60], ids=["many rows", "many columns"])
def test_each_block_is_predicted_from_all_others(columns):
    rng = np.random.default_rng(columns)
    rows = 24
    E = rng.standard_normal((rows, columns))
    level = BackgroundLevel(
        E, np.tile(rng.uniform(0.5, 2.0, 6), rows // 6), rng.uniform(0.1, 1.0, columns)
    )
    design, spread = rng.standard_normal((rows, 3)), np.array([1.0, 0.5, 2.0])
    y = rng.standard_normal(rows)
    f = Finalist((), 0, np.zeros(3), np.eye(3), y, y, design, spread, 0.0)
    block = np.array([0, 0, 1, 2])
    K = np.diag(level.v0) + (E * level.V) @ E.T + (design * spread**2) @ design.T
    errors = np.empty(rows)
    for b in range(3):
        own = np.repeat(block, 6) == b
        gain = K[np.ix_(own, ~own)] @ np.linalg.inv(K[np.ix_(~own, ~own)])
        mean = gain @ y[~own]
        errors[own] = y[own] - mean
    assert prediction_errors(level, f, block) == pytest.approx(errors, rel=1e-6)
