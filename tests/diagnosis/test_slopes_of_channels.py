"""Slopes by amplitudes of several channels, taken at once, are those of each alone."""

import numpy as np
import pytest

from wrenchbed import registry
from wrenchbed.benchmark.lookalikes import ExperimentDesign, draw, recording
from wrenchbed.diagnosis.explain.structures import analyse
from wrenchbed.diagnosis.prepare.prepare_recording import prepare
from wrenchbed.planning.choose import poses

STEP, SHAPE_STEP = 0.1, 0.02


@pytest.fixture(scope="module")
def analysis():
    robot = registry.load("robots", "ur5")
    design = ExperimentDesign.of_plan(poses(robot, 30, 3), robot)
    return analyse(prepare(recording(design, draw(design, 4, "single", "sensor.drift"))))


def shaped(hypotheses, name):
    """The hypothesis of an effect with most amplitudes, one with shapes if there is such."""
    of = [h for h in hypotheses if h.name == name]
    return max(of, key=lambda h: (bool(h.variant.shape), len(h.variant.free)))


@pytest.mark.parametrize(
    "names",
    [
        ("sensor.jump",),
        ("sensor.creep",),
        ("sensor.drift", "sensor.jump"),
        ("tool.loose", "sensor.hysteresis"),
        ("sensor.crosstalk", "sensor.jump"),  # mixes channels: not at once
    ],
)
def test_slopes_of_several_channels(analysis, names):
    parts = tuple(shaped(analysis.dictionary.hypotheses, name) for name in names)
    r = analysis.refitter
    x = r.start(parts)
    x = np.where(x == 0.0, np.random.default_rng(1).uniform(0.5, 2.0, len(x)), x)
    f = r.response(parts, x)
    calls = [0]
    respond = r.response

    def counted(*given):
        calls[0] += 1
        return respond(*given)

    r.response = counted
    told = r.design(parts, x, f, range(len(x)))
    r.response = respond
    first = 0
    for h in parts:
        for k in range(len(h.variant.free) + len(h.variant.shape)):
            if h.variant.shape:
                step = STEP if k < len(h.variant.free) else SHAPE_STEP
                moved = x.copy()
                moved[first + k] += step
                assert told[:, first + k] == pytest.approx((respond(parts, moved) - f) / step)
            else:
                assert told[:, first + k] == pytest.approx(r.d.E[:, h.columns[k]])
        first += len(h.variant.free) + len(h.variant.shape)
    moved = sum(len(h.variant.free) + len(h.variant.shape) for h in parts if h.variant.shape)
    assert (calls[0] < moved) is ("sensor.crosstalk" not in names)
