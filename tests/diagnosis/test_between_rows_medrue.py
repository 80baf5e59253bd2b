"""What shows between rows, on a robot whose torques are quieter than its forces are."""

import numpy as np
import pytest
from test_between_rows import row_effects

from altered import at_point, with_added
from wrenchbed import registry
from wrenchbed.benchmark.lookalikes import ExperimentDesign, draw, recording
from wrenchbed.benchmark.lookalikes.imperfection import raised_variance
from wrenchbed.data.plan import Plan

ROBOT = registry.load("robots", "medrue")
EFFECTS = ("sensor.noise", "sensor.quantization", "base.vibration")
NEAR = 0.3
"""Rise of a row's variance far enough below the half that counts."""


DESIGN = ExperimentDesign.of_plan(
    Plan.of("medrue", ROBOT.sample(70, np.random.default_rng(5))), ROBOT, samples=60
)


def rise_of_background(case):
    return max(
        float(raised_variance(DESIGN, item, case.clean).max())
        for item, _ in case.items
        if item.rows is not None and item.name == "background"
    )


def test_nothing_is_claimed_that_does_not_count():
    quiet = 0
    for seed in range(300, 330):
        case = draw(DESIGN, seed, "none")
        found = row_effects(recording(DESIGN, case))
        if rise_of_background(case) < NEAR:
            quiet += 1
            assert found == (), (seed, found)
        assert {f.effect for f in found} <= {"base.vibration"}
    assert quiet > 12


@pytest.mark.parametrize("effect", EFFECTS)
def test_each_cause_is_named_first(effect):
    for seed in range(400, 410):
        case = draw(DESIGN, seed, "single", effect)
        if case.rows[effect] >= 1.0 and case.rows[effect] > 2.0 * rise_of_background(case):
            assert row_effects(recording(DESIGN, case))[0].effect == effect, seed


def test_a_strong_shaking_is_no_noise():
    """Its own products must not count as noise that hides how the poses differ."""
    for seed in range(3):
        case = draw(DESIGN, seed, "single", "base.vibration", 12.0)
        assert case.rows["base.vibration"] > 50.0
        (found,) = row_effects(recording(DESIGN, case))
        assert found.effect == "base.vibration", seed
        truth = case.rows["base.vibration"]
        assert found.rise == pytest.approx(truth, rel=0.25)


def test_a_shaking_that_does_not_count_is_no_noise_either():
    rec = recording(DESIGN, draw(DESIGN, 7, "none"))
    rotation = np.asarray(ROBOT.sensor_pose(rec.q, DESIGN.theta)[0])
    force = DESIGN.load.mass * np.sin(2 * np.pi * 14.0 * rec.t)[:, None] * rotation[:, 0, :]
    shaking = at_point(force, DESIGN.load.cog)
    fraction = (shaking.std(axis=0) / DESIGN.noise_std) ** 2
    shaken = with_added(rec, shaking * np.sqrt(0.4 / fraction.max()))
    assert "sensor.noise" not in {f.effect for f in row_effects(shaken)}
