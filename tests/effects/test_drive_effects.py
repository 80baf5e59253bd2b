"""The contract of every drive effect, and the simulator's formula of it, which is other code."""

import inspect
from dataclasses import replace

import numpy as np
import pytest

from wrenchbed import registry
from wrenchbed.effects.drives.base import DriveEffect, DriveResidual, DriveRows, StatedNumber
from wrenchbed.effects.drives.operators import late, moving
from wrenchbed.simulation.drives.faults import Rows, active_fault

NAMES = registry.names("drives")
RATE, COULOMB = 125.0, 6.0
SIMULATED = [n for n in NAMES if n not in ("drive.bandwidth", "drive.ripple", "drive.stiction")]
"""Those that the simulator has by the same meaning; its ripple is one of a gain."""


def rows(**changed):
    """A minute of joint 2 in both directions, fast and slow, that warms up."""
    t = np.arange(0.0, 60.0, 1.0 / RATE)
    w = 2.0 * np.pi * np.array([0.05, 0.13, 0.31])
    size = np.array([0.8, 0.25, 0.1])
    angle = np.sin(np.outer(t, w)) @ size
    speed = np.cos(np.outer(t, w)) @ (size * w)
    acceleration = -np.sin(np.outer(t, w)) @ (size * w**2)
    body = 30.0 * np.cos(angle + 0.4) + 2.0 * acceleration
    stated = ("drive.coulomb", "drive.viscous", "drive.inertia", "drive.constant", "drive.offset")
    made = DriveRows(
        2, t, RATE, angle, speed, acceleration, body + COULOMB * np.sign(speed), body, True,
        COULOMB, True, dict.fromkeys(stated, 0.1), frozenset(), 20.0 + 0.1 * t,
    )  # fmt: skip
    return replace(made, **changed)


def of(effect, at, y):
    """Columns and cause of an effect, with those of the shape that a torque y (N,) suggests."""
    columns = effect.columns(at)
    block = effect.block(at, columns)
    ones = np.ones((len(y), 1))
    use = np.ones(len(y), dtype=bool)
    residual = DriveResidual(y, use, at.angle, y, ones, lambda x: x)
    scanned = effect.scan(at, residual)
    return (columns, block) if scanned is None else ((*columns, *scanned[0]), scanned[1])


@pytest.mark.parametrize("hinge", [True, False])
@pytest.mark.parametrize("name", NAMES)
def test_an_effect_is_complete(name, hinge):
    effect, at = registry.load("drives", name), rows(hinge=hinge)
    assert isinstance(effect, DriveEffect) and effect.name == name
    assert ("{joint}" in effect.title and effect.title[0].islower()) or "Coulomb" in effect.title
    assert "Seen in: " in inspect.getdoc(type(effect))
    assert effect.size.plausible > 0.0
    columns, block = of(effect, at, np.sin(20.0 * at.angle))
    names = [c.name for c in columns]
    beside = [f"{word}.2" for word in effect.beside]
    assert len(set(names)) == len(names) and all(n.endswith(".2") for n in names)
    assert all(c.data.shape == at.t.shape and np.isfinite(c.data).all() for c in columns)
    assert block.key == (name, 2) and set(block.columns) <= {*names, *beside}
    assert set(beside) <= set(block.columns)
    assert block.level == (1.0 if effect.size.absolute else COULOMB)
    begins = effect.size.columns or ("",)
    assert any(c.startswith(begins) for c in block.columns)


@pytest.mark.parametrize("name", SIMULATED)
def test_its_columns_fit_the_simulators_formula(name):
    effect, at = registry.load("drives", name), rows()
    more = {"order": 63.0} if name == "drive.cogging" else {}  # a motor's, not its gear's
    fault = active_fault(name, {"joint": 2, **more}, np.full(6, COULOMB))
    seen = Rows(at.t, at.angle, at.speed, at.acceleration, at.body, at.warm, COULOMB)
    made = fault.act(seen, at.total.copy()) - at.total
    columns, block = of(effect, at, made)
    beside = [np.ones_like(at.t), at.sign]  # what every fit has
    fitted = np.column_stack([*beside, *(c.data for c in columns if c.name in block.columns)])
    use = moving(at.speed, RATE)  # at rest friction has no known sign
    left = made[use] - fitted[use] @ np.linalg.lstsq(fitted[use], made[use], rcond=None)[0]
    assert left.std() < 0.2 * made[use].std() + 1e-9


def test_what_nobody_states_is_no_cause():
    at = rows(is_stated=False, free=frozenset(("drive.coulomb", "drive.constant")))
    for name in NAMES:
        effect = registry.load("drives", name)
        columns = effect.columns(at)
        if isinstance(effect, StatedNumber):
            assert effect.block(at, columns) is None
            assert columns[0].free == (name in at.free)
    assert registry.load("drives", "drive.temperature").columns(rows(warm=None)) == ()


def test_a_signal_is_late_by_a_tenth_of_a_row_without_a_filter():
    """Linear interpolation is late by half a row more: 12 % of this speed."""
    t = np.arange(0.0, 4.0, 0.04)
    change = late(np.sin(2.0 * np.pi * t), t, 0.002)
    speed = 2.0 * np.pi * np.cos(2.0 * np.pi * t)
    assert change[2:-2] == pytest.approx(-0.002 * speed[2:-2], abs=0.06 * 0.002 * 2.0 * np.pi)
