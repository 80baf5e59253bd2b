"""Joint values of real encoders: smoothed as far as their path allows, else refused."""

import numpy as np
import pytest

import wrenchbed as wb
from wrenchbed.calibration.calibrate import calibrate
from wrenchbed.calibration.observations import window_of
from wrenchbed.data.recording import Recording
from wrenchbed.errors import CalibrationError


@pytest.mark.parametrize("counts", [6e-5, 1.2e-4])
def test_counts_of_an_encoder_at_a_high_rate_take_a_wider_window(tmp_path, counts):
    plan = wb.multisine(wb.load("robots", "ur5"), 10.0, 500.0, 3)
    with wb.SimDriver(wb.SimOptions("ur5", noise="white", seed=5)) as driver:
        wb.record(driver, plan, tmp_path / "rec.parquet")
    moved = Recording.read(tmp_path / "rec.parquet")
    q = {n: np.round(moved.columns[n] / counts) * counts for n in moved.joints}
    coarse = Recording(moved.metadata, {**moved.columns, **q}, moved.name)
    assert window_of(coarse) > window_of(moved)
    fine, fit = calibrate(moved), calibrate(coarse)
    for name in ("tool.mass", "tool.cog.x", "tool.cog.y", "tool.cog.z"):
        assert abs(fit[name].value - fine[name].value) < 1.0 * fine[name].std
    noise = 1e-3 * np.random.default_rng(0).standard_normal(len(moved))
    loud = {n: x + noise for n, x in q.items()}
    with pytest.raises(CalibrationError, match="is rough"):
        calibrate(Recording(moved.metadata, {**moved.columns, **loud}, moved.name))
