"""The rigid tool by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wrenchbed.calibration.calibrate import identify_from_gravity
from wrenchbed.errors import CalibrationError
from wrenchbed.physics.rotations import matrix
from wrenchbed.physics.wrench import Tool, physical_inertia, wrench

G = np.array([0.0, 0.0, -9.80665])


def tool(mass=2.0, cog=(0.1, 0.0, 0.0), inertia=(0.01, 0.02, 0.03), own=0.0) -> Tool:
    return Tool(np.array(mass), np.array(cog), np.diag(inertia), np.array(own))


def test_at_rest_the_weight_acts_at_the_centre_of_gravity():
    load = wrench(np.eye(3)[None], np.zeros((1, 3)), tool(own=0.5), G)[0]
    assert np.allclose(load, [0, 0, -2.5 * 9.80665, 0, 0.1 * 2 * 9.80665, 0])


@given(st.floats(0.05, 20.0), st.tuples(*[st.floats(-0.3, 0.3)] * 3), st.integers(0, 10_000))
def test_mass_centre_and_bias_return_from_any_orientations(mass, cog, seed):
    rng = np.random.default_rng(seed)
    rotation = matrix(rng.normal(size=(12, 4)))
    bias = rng.normal(size=6)
    load = Tool(np.array(mass), np.array(cog), np.zeros((3, 3)), np.array(0.0))
    found = identify_from_gravity(G @ rotation, wrench(rotation, np.zeros((12, 3)), load, G) + bias)
    assert np.isclose(found.mass, mass, rtol=1e-9)
    assert np.allclose(found.cog, cog, atol=1e-9)
    assert np.allclose(found.bias, bias, atol=1e-7)


def test_the_closed_form_is_the_weighted_least_squares_solution():
    rng = np.random.default_rng(1)
    rotation = matrix(rng.normal(size=(40, 4)))
    weight = rng.uniform(0.5, 2.0, 6) ** 2
    y = rng.normal(size=(40, 6)) + wrench(rotation, np.zeros((40, 3)), tool(), G)
    g = G @ rotation
    design = np.zeros((40, 6, 10))
    design[:, :3, 0] = g
    for k, axis in enumerate(np.eye(3)):
        design[:, 3:, 1 + k] = np.cross(axis, g)
    design[:, :, 4:] = np.eye(6)
    root = np.sqrt(weight)
    a = (design * root[:, None]).reshape(-1, 10)
    wanted = np.linalg.lstsq(a, (y * root).ravel(), rcond=None)[0]
    found = identify_from_gravity(G @ rotation, y, weight)
    assert np.isclose(found.mass, wanted[0])
    assert np.allclose(found.cog, wanted[1:4] / wanted[0])
    assert np.allclose(found.bias, wanted[4:])


def test_of_two_orientations_the_moment_is_the_shortest_that_explains_them():
    rotation = matrix(np.random.default_rng(2).normal(size=(2, 4)))
    y = wrench(rotation, np.zeros((2, 3)), tool(), G)
    found = identify_from_gravity(G @ rotation, y)
    g = G @ rotation
    unseen = g[0] - g[1]
    torque = np.cross(found.mass * found.cog, g) + found.bias[3:]
    assert np.allclose(torque, y[:, 3:], atol=1e-12)
    assert abs(unseen @ found.cog) < 1e-12 < abs(unseen @ tool().cog)


def test_one_orientation_only_is_refused():
    rotation = np.repeat(np.eye(3)[None], 8, axis=0)
    with pytest.raises(CalibrationError, match="one orientation"):
        identify_from_gravity(G @ rotation, np.ones((8, 6)))


def test_only_inertias_of_bodies_are_physical():
    assert physical_inertia((1.0, 1.0, 1.9, 0, 0, 0))
    assert physical_inertia((0, 0, 0, 0, 0, 0))
    assert not physical_inertia((1.0, 1.0, 2.1, 0, 0, 0))
    assert not physical_inertia((1.0, 1.0, 1.0, 2.0, 0, 0))
