"""Several changes of zero in one recording are that, at their moments, and no drift."""

from dataclasses import replace

import numpy as np
import pytest

import wrenchbed as wb
from support.simulated import UR5_TRUTH as TRUTH
from support.simulated import WHITE, static
from wrenchbed.physics.wrench import CHANNELS

POSES, ROWS = 40, 10
STEP = np.array([1.0, 1.0, 1.0, 0.05, 0.05, 0.05])
"""Standard deviation of a slip of the zero [N, N·m]."""


def recording(change, seed):
    truth = {k: v for k, v in TRUTH.items() if not k.startswith(("mount", "sensor"))}
    rec = static("ur5", truth, poses=POSES, samples=ROWS, noise=WHITE, seed=seed)
    wrench = change(rec.wrench.copy())
    columns = dict(rec.columns) | {c: wrench[:, k] for k, c in enumerate(CHANNELS)}
    tool = replace(rec.metadata.tool, mass=1.42, cog=(0.007, -0.002, 0.083))
    return replace(rec, columns=columns, metadata=replace(rec.metadata, tool=tool))


def moments(rec, rows):
    return [rec.t[k] for k in rows]


@pytest.mark.sampled
@pytest.mark.parametrize("seed", range(10))
def test_a_sensor_that_was_zeroed_twice_jumps_twice(seed):
    rows = [13 * ROWS, 27 * ROWS]

    def zeroed(wrench):
        for k in rows:
            wrench[k:] -= wrench[k]
        return wrench

    rec = recording(zeroed, seed)
    answer = wb.diagnose(rec).diagnosis.to_json()
    (cause,) = answer["which"]
    assert cause["effect"] == "sensor.jump" and cause["probability"] > 0.9
    found = [cause["parameters"][name]["value"] for name in ("time", "time2")]
    between = rec.t[ROWS] - rec.t[ROWS - 1]
    for at, value in zip(moments(rec, rows), found, strict=True):
        assert at - between <= value <= at
    assert answer["gap"]["with_effects"] < 0.5


@pytest.mark.sampled
@pytest.mark.parametrize("seed", range(10))
def test_three_slips_are_no_drift(seed):
    rng = np.random.default_rng(seed)
    rows = [k * ROWS for k in np.sort(rng.choice(np.arange(6, POSES - 5, 5), 3, replace=False))]

    def slipped(wrench):
        for k in rows:
            wrench[k:] += np.where(rng.random(6) < 0.5, -1.0, 1.0) * rng.uniform(0.6, 1.4, 6) * STEP
        return wrench

    answer = wb.diagnose(recording(slipped, seed)).diagnosis.to_json()
    assert [w["effect"] for w in answer["which"]] == ["sensor.jump"]
    assert "time3" in answer["which"][0]["parameters"]
