"""Robots that are worked on together come out as each does alone, to the last bit."""

from dataclasses import replace

import numpy as np
import pytest
from test_campaign import bare

import wrenchbed as wb
from wrenchbed.campaigns import simulated_robots
from wrenchbed.campaigns.settings import Fleet
from wrenchbed.campaigns.simulated_robots import recorded, robot_rows, tasks

FLEETS = {
    "wander": Fleet("medrue", 5, poses=60, samples=30),
    "explained": Fleet("medrue", 4, poses=50, samples=1),
    "ur5": Fleet("ur5", 5, poses=50, samples=20),
    "few": Fleet("ur5", 3, poses=20, samples=6),
    "poses": Fleet("ur5", 3, ("noise", "poses"), poses=24, samples=8),
}


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


def test_a_robot_that_cannot_be_fitted_leaves_the_others_alone(monkeypatch):
    fleet = FLEETS["ur5"]
    results = recorded(fleet, range(3))
    recording, theta = results[1]
    broken = recording.columns | {"fx": np.full(len(recording), 2.0)}
    results[1] = replace(recording, columns=broken), theta
    monkeypatch.setattr(simulated_robots, "recorded", lambda *_: results)
    errors = [row["error"] for row in simulated_robots.robot_rows(fleet, range(3))]
    assert "column 'fx' is 2" in errors[1] and errors[0] == errors[2] == ""


def test_predictions_of_many_robots_are_those_of_each():
    robot = wb.load("robots", "medrue")
    model, q = wb.Model.of(robot), robot.sample(20, np.random.default_rng(1))
    shift = np.random.default_rng(2).uniform(-0.3, 0.3, (4, len(model.parameters)))
    thetas = model.parameters.nominal + shift * model.parameters.tolerance
    for k, reading in enumerate(model.predict(q, thetas[:, None])):
        assert np.array_equal(reading, model.predict(q, thetas[k]))
