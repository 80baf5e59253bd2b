"""MedRUE's Jacobian at rest, written out in numpy, against complex steps of the whole chain."""

import numpy as np
import pytest

import wrenchbed as wb
from wrenchbed.robots.base import Robot
from wrenchbed.robots.compiled import statics
from wrenchbed.simulation.closed_form import Model

MEDRUE = wb.load("robots", "medrue")


@pytest.fixture(autouse=True)
def nothing_compiled(monkeypatch):
    monkeypatch.setattr(statics, "_FUNCTIONS", {})


@pytest.mark.parametrize("seed", range(4))
def test_slopes_written_out_are_those_of_complex_steps(monkeypatch, seed):
    model, rng = Model.of(MEDRUE), np.random.default_rng(seed)
    theta = model.parameters.nominal + 0.3 * rng.uniform(-1, 1, len(model.parameters)) * (
        model.parameters.tolerance
    )
    theta[-9:] = (np.eye(3) + rng.normal(0, 0.05, (3, 3))).ravel()  # unequal force gains
    q = MEDRUE.sample(40, rng)
    q = q[[i for i in range(40) if i not in MEDRUE.infeasible(q, theta[: len(MEDRUE.parameters)])]]
    columns = list(range(len(model.parameters)))
    written = model.jacobian(q, theta, columns)
    monkeypatch.setattr(type(MEDRUE), "gravity_slopes", Robot.gravity_slopes)
    stepped = model.jacobian(q, theta, columns)
    assert np.abs(stepped).max(axis=(0, 1)).max() > 1.0
    scale = np.abs(stepped).max(axis=(0, 2), keepdims=True)
    assert np.abs(written - stepped).max() < 1e-11 * max(1.0, float(scale.max()))


def test_a_wrong_slope_would_be_seen(monkeypatch):
    model = Model.of(MEDRUE)
    q = MEDRUE.sample(5, np.random.default_rng(0))
    columns = [model.parameters.index("L12")]
    right = model.jacobian(q, model.parameters.nominal, columns)
    off = type(MEDRUE).gravity_slopes
    monkeypatch.setattr(type(MEDRUE), "gravity_slopes", lambda *a: 1.001 * off(*a))
    assert np.abs(model.jacobian(q, model.parameters.nominal, columns) - right).max() > 1e-6
