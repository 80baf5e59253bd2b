"""Robots that are worked on together come out as each does alone, to the last bit."""

import json
from dataclasses import replace

import numpy as np
import pytest
from test_campaign import bare

import wrenchbed as wb
from wrenchbed.calibration.calibrate import calibrate
from wrenchbed.calibration.calibrate_many import calibrate_each
from wrenchbed.campaigns.settings import Fleet
from wrenchbed.campaigns.simulated_robots import recorded, robot_rows, tasks
from wrenchbed.errors import CalibrationError

FLEETS = {
    "wander": Fleet("medrue", 5, poses=60, samples=30),
    "explained": Fleet("medrue", 4, poses=50, samples=1),
    "ur5": Fleet("ur5", 5, poses=50, samples=20),
    "few": Fleet("ur5", 3, poses=20, samples=6),
    "poses": Fleet("ur5", 3, ("noise", "poses"), poses=24, samples=8),
}


def same(a, b) -> bool:
    return json.dumps(a.to_json()) == json.dumps(b.to_json())


@pytest.mark.sampled
@pytest.mark.parametrize("name", FLEETS)
def test_rows_of_robots_together_are_those_of_each_alone(name):
    fleet = FLEETS[name]
    together = [bare(row) for row in robot_rows(fleet, range(fleet.robots))]
    alone = [bare(robot_rows(fleet, [k])[0]) for k in reversed(range(fleet.robots))]
    assert [repr(row) for row in together] == [repr(row) for row in reversed(alone)]
    assert all(row["error"] == "" for row in together)


@pytest.mark.parametrize(("robots", "most"), [(12, 1), (90, 11), (900, 25)])
def test_every_robot_is_in_one_task(robots, most):
    numbers = tasks(range(robots), 2)
    assert [k for some in numbers for k in some] == list(range(robots))
    assert max(map(len, numbers)) == most


def test_a_robot_that_cannot_be_fitted_leaves_the_others_alone():
    fleet = FLEETS["ur5"]
    recordings = [recording for recording, _ in recorded(fleet, range(4))]
    broken = recordings[1].columns | {"fx": np.full(len(recordings[1]), 2.0)}
    recordings[1] = replace(recordings[1], columns=broken)
    ((longer, _),) = recorded(replace(fleet, poses=30), [2])
    fits = calibrate_each([*recordings, longer])
    assert isinstance(fits[1], CalibrationError) and "column 'fx' is 2" in str(fits[1])
    for k in (0, 2, 3):
        assert same(fits[k], calibrate(recordings[k]))
    assert same(fits[4], calibrate(longer))


@pytest.mark.parametrize("columns", ["free", "candidates"])
def test_predictions_and_slopes_of_many_robots_are_those_of_each(columns):
    robot = wb.load("robots", "medrue")
    model, q = wb.Model.of(robot), robot.sample(20, np.random.default_rng(1))
    some = model.parameters.select(getattr(robot, columns))
    shift = np.random.default_rng(2).uniform(-0.3, 0.3, (4, len(model.parameters)))
    thetas = model.parameters.nominal + shift * model.parameters.tolerance
    for k, slopes in enumerate(model.jacobian(q, thetas[:, None], some)):
        assert np.array_equal(slopes, model.jacobian(q, thetas[k], some))
    for k, reading in enumerate(model.predict(q, thetas[:, None])):
        assert np.array_equal(reading, model.predict(q, thetas[k]))
