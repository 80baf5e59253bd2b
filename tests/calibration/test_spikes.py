"""Spikes: how far a row lies outside its neighbours."""

import numpy as np

from wrenchbed.calibration.checks.rows import _off_neighbours


def test_a_row_is_off_by_its_distance_from_the_median_of_three():
    y = np.random.default_rng(0).integers(-5, 5, 500).astype(float)
    median = np.median([np.roll(y, 1), y, np.roll(y, -1)], axis=0)
    off = _off_neighbours(y)
    assert np.array_equal(off[1:-1], np.abs(y - median)[1:-1])
    assert off[0] == off[-1] == 0.0
