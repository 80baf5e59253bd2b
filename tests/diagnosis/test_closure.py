"""Gaps on sealed rows and the share that is closed, on numbers that a hand can check."""

from types import SimpleNamespace

import numpy as np
import pytest

from wrenchbed import registry
from wrenchbed.diagnosis.gap import closure
from wrenchbed.diagnosis.gap.held_out import HeldOut
from wrenchbed.diagnosis.prepare.configuration import BIAS, Configuration
from wrenchbed.simulation.closed_form import Model

STD = np.array([2.0, 2.0, 2.0, 0.5, 0.5, 0.5])
COUNT = np.array([1, 4, 4, 10])
SEALED = np.array([False, True, False, True])


def prepared(y, scatter=None, moving=False, mode="static", noise=None):
    """Four poses, the second and the last of them sealed; a scene row between is not held."""
    return SimpleNamespace(
        covariance=np.diag(STD**2), sigma=STD, sealed=SEALED, y=y, count=COUNT, block=np.arange(4),
        scatter=np.zeros((4, 6, 6)) if scatter is None else scatter, moving=moving,
        noise=np.ones(6) if noise is None else noise,
        scene=SimpleNamespace(held=np.array([True, True, False, True, True])),
        averaged=mode == "dynamic" and not moving,
    )  # fmt: skip


def test_a_gap_is_the_mean_square_over_noise_less_one():
    y = np.zeros((4, 6))
    y[1], y[3] = 3.0 * STD, 1.0 * STD
    reading = np.zeros((5, 6))
    sealed = HeldOut(prepared(y))
    assert sealed.rows == 14
    assert sealed.of(reading) == pytest.approx([8.0, 0.0])
    assert sealed.mean(sealed.of(reading)) == pytest.approx(8.0 * 4 / 14)
    assert sealed.channels(reading) == pytest.approx([8.0 * 4 / 14] * 6)
    reading[1], reading[4] = y[1], -y[3]  # of the sealed poses; the last held row is the fifth
    assert sealed.of(reading) == pytest.approx([-1.0, 3.0])


def test_rows_that_scatter_about_their_mean_add_to_the_gap():
    scatter = np.zeros((4, 6, 6))
    scatter[1] = np.diag(STD**2)  # each row's own noise
    scatter[3, 0, 0] = 3.0 * STD[0] ** 2
    sealed = HeldOut(prepared(np.zeros((4, 6)), scatter))
    zero = np.zeros((5, 6))
    assert sealed.of(zero) == pytest.approx([0.0, 0.5 - 1.0])
    assert sealed.channels(zero)[0] == pytest.approx((0.0 * 4 + 2.0 * 10) / 14)
    assert sealed.channels(zero)[1] == pytest.approx((0.0 * 4 - 1.0 * 10) / 14)


def test_correlated_channels_are_whitened_together():
    p = prepared(np.zeros((4, 6)))
    p.covariance, p.sigma = np.eye(6), np.ones(6)
    p.covariance[0, 1] = p.covariance[1, 0] = 0.6
    p.y[1, :2] = 1.0
    expected = np.ones(2) @ np.linalg.inv(p.covariance[:2, :2]) @ np.ones(2) / 6 - 1.0
    assert HeldOut(p).of(np.zeros((5, 6)))[0] == pytest.approx(expected)


def test_the_floor_is_what_rows_scatter_with_the_mean_s_degree_of_freedom_back():
    scatter = np.zeros((4, 6, 6))
    scatter[1] = 0.75 * np.diag(STD**2)  # of 4 rows: 0.75 · 4 / 3 = 1
    scatter[3] = 1.8 * np.diag(STD**2)  # of 10 rows: 1.8 · 10 / 9 = 2
    assert HeldOut(prepared(np.zeros((4, 6)), scatter)).floor() == pytest.approx([0.0, 1.0])
    p = prepared(np.zeros((4, 6)), scatter)
    p.count = np.array([1, 1, 1, 2])  # one row shows no scatter; two of 1.8 · 2
    assert HeldOut(p).floor() == pytest.approx([0.0, 2.6])


def test_the_floor_of_averages_of_a_motion_is_their_noise():
    p = prepared(np.zeros((4, 6)), mode="dynamic", noise=np.array([1.0, 2, 3, 1, 2, 3]))
    assert HeldOut(p).floor() == pytest.approx([1.0, 1.0])


def blocks(count, block):
    return SimpleNamespace(count=np.array(count), block=np.array(block))


def test_the_share_closed_weighs_rows_and_draws_blocks():
    sealed = blocks([1, 1, 2], [0, 1, 1])
    origin, end, floor = np.array([5.0, 9.0, 9.0]), np.array([1.0, 5.0, 3.0]), np.ones(3)
    share, interval = closure._closed(sealed, origin, end, floor, 0)
    assert share == pytest.approx((4.0 + 4.0 + 2 * 6.0) / (4.0 + 8.0 + 2 * 8.0))
    low, high = interval  # of draws of two blocks: only the first, only the second, or both
    assert (low, high) == pytest.approx((16 / 24, 1.0))
    again = closure._closed(sealed, origin, end, floor, 0)
    assert again == (share, interval)


def test_the_interval_leaves_out_a_fortieth_on_each_side():
    rng = np.random.default_rng(3)
    gain = rng.normal(0.5, 0.2, 400)
    sealed = blocks(np.ones(400, dtype=int), np.arange(400))
    share, (low, high) = closure._closed(sealed, np.ones(400), 1.0 - gain, np.zeros(400), 1)
    assert share == pytest.approx(gain.mean())
    assert high - low == pytest.approx(2 * 1.96 * gain.std() / 20.0, rel=0.1)
    assert (low + high) / 2 == pytest.approx(share, abs=0.003)


def test_nothing_is_closed_where_nothing_is_above_the_floor():
    sealed = blocks([1, 1], [0, 1])
    assert closure._closed(sealed, np.ones(2), np.zeros(2), np.ones(2), 0) == (None, None)
    share, interval = closure._closed(sealed, np.array([3.0, 0.0]), np.ones(2), np.ones(2), 0)
    assert share == pytest.approx(1.0)  # (2 − 1) / (2 − 1); draws of the second block alone: none
    assert np.isfinite(interval).all()


class Reads:
    """A twin whose readings are a number for each of its effects."""

    def __init__(self, active, theta=0.0):
        self.active, self.theta = active, theta

    def changed(self, active=None, theta=0.0):
        return Reads(self.active if active is None else active, theta)

    def wrench(self, scene):
        return self.theta + sum(a.made for a in self.active)


def test_the_closed_share_is_split_by_what_comes_back_without_each(monkeypatch):
    named = [
        SimpleNamespace(effect=SimpleNamespace(name=n), made=v)
        for n, v in (("base.tilt", 3.0), ("cable.pull", 1.0), ("tool.loose", -2.0))
    ]
    monkeypatch.setattr(closure, "replace", lambda twin, **k: twin.changed(**k))
    sealed = SimpleNamespace(of=lambda reading: 10.0 - reading, mean=float)
    a = SimpleNamespace(prepared=SimpleNamespace(scene=None))
    told = closure._shares(a, Reads(tuple(named)), sealed, 10.0 - 2.0, 0.8, [])
    assert told == pytest.approx({"base.tilt": 0.6, "cable.pull": 0.2, "tool.loose": 0.0})
    one_stated = SimpleNamespace(theta=-4.0)
    monkeypatch.setattr(closure, "_as_stated", lambda a, twin, name: one_stated)
    wrong = closure._shares(a, Reads(tuple(named)), sealed, 10.0 - 2.0, 0.8, ["tool.mass"])
    expected = {"base.tilt": 0.3, "cable.pull": 0.1, "tool.loose": 0.0, "tool.mass": 0.4}
    assert wrong == pytest.approx(expected)
    none = closure._shares(a, Reads(tuple(named[2:])), sealed, 12.0, 0.8, [])
    assert none == {"tool.loose": 0.0}


@pytest.mark.parametrize("robot", ["ur5", "medrue"])
def test_a_load_and_a_bias_are_put_where_they_belong(robot):
    robot = registry.load("robots", robot)
    model = Model.of(robot)
    nominal = Configuration(model, model.parameters.nominal + 0.0)
    bias = np.arange(1.0, 7.0)
    given = nominal.with_load(1.25, np.array([0.01, -0.02, 0.06]), bias)
    assert given.mass == pytest.approx(1.25)
    assert given.cog == pytest.approx([0.01, -0.02, 0.06])
    assert given.bias == pytest.approx(bias)
    told = dict(zip(model.parameters.names, given.theta, strict=True))
    assert [v for k, v in told.items() if k in BIAS] == pytest.approx(bias)
    assert nominal.theta == pytest.approx(model.parameters.nominal)  # a copy
    assert len(given.robot_theta) == len(robot.parameters)


def stated_again(name):
    """Parameters of a twin with one number as the metadata states it: (mass, cog, bias)."""
    robot = registry.load("robots", "ur5")
    model = Model.of(robot)
    nominal = Configuration(model, model.parameters.nominal)
    stated = nominal.with_load(0.9, np.zeros(3), np.zeros(6))
    now = nominal.with_load(1.4, np.array([0.0, 0.0, 0.1]), np.ones(6))
    twin = SimpleNamespace(model=model, theta=now.theta)
    a = SimpleNamespace(prepared=SimpleNamespace(configuration=stated))
    told = closure._as_stated(a, twin, name)
    return told.mass, float(told.cog[2]), float(np.mean(told.bias))


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("tool.mass", (0.9, 0.1, 1.0)),
        ("tool.cog", (1.4, 0.0, 1.0)),
        ("sensor.bias", (1.4, 0.1, 0.0)),
    ],
)
def test_one_number_alone_goes_back_to_what_is_stated(name, expected):
    assert stated_again(name) == pytest.approx(expected)


def test_the_interval_draws_from_every_block():
    held = SimpleNamespace(block=np.arange(40), count=np.ones(40, dtype=int))
    gaps = np.repeat([0.0, 1.0], 20)  # drawn from a few blocks at one end they would be alike
    drawn = closure.Bootstrap([held], 0).mean(gaps)
    assert drawn.value == 0.5
    assert 0.3 < drawn.low < 0.42 and 0.58 < drawn.high < 0.7  # 0.5 ∓ 1.96 · 0.5/√40


def test_rows_of_two_recordings_count_alike_and_their_blocks_are_not_one():
    few, many = (
        SimpleNamespace(block=np.arange(n), count=np.full(n, k)) for n, k in ((10, 1), (10, 3))
    )
    drawn = closure.Bootstrap([few, many], 0).mean(np.repeat([1.0, 0.0], 10))
    assert drawn.value == 0.25
    assert drawn.low < 0.2 < 0.3 < drawn.high  # ten blocks alone would have no spread
