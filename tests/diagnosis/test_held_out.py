"""Gaps on held-out rows, by hand; a fold is judged by fits that did not see it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from linear_case import ROWS, dictionary, named, readings, refitter
from simulated import UR5_TRUTH, WHITE, static, with_tool
from wrenchbed import registry
from wrenchbed.diagnosis.evidence.search import Searcher
from wrenchbed.diagnosis.explain.claims import moved_by
from wrenchbed.diagnosis.explain.refit import Refitter
from wrenchbed.diagnosis.explain.structures import Analysis, readings_from_baseline
from wrenchbed.diagnosis.explain.structures import build as build_dictionary
from wrenchbed.diagnosis.gap.gap_bootstrap import Bootstrap, Closure, Interval
from wrenchbed.diagnosis.gap.held_out import Claimed, CrossFit, HeldOut, restored, twin_of
from wrenchbed.diagnosis.prepare.bias_and_load_fit import calibrate
from wrenchbed.diagnosis.prepare.configured_simulator import Configuration
from wrenchbed.diagnosis.prepare.prepare_recording import prepare
from wrenchbed.effects.chain import ActiveEffect, effects, respond
from wrenchbed.simulation.closed_form import Model

STD = np.array([2.0, 2.0, 2.0, 0.5, 0.5, 0.5])
ONES, ZERO = np.ones(6), np.zeros((5, 6))
"""Noise of a row, and readings of a simulator: four poses, a scene row between is not held."""


def observed(y=ZERO[:4], scatter=ZERO[:4], averaged=False, noise=ONES, count=(1, 4, 4, 10)):
    """Four poses, the first and the third set aside; their rows scatter by variances (4, 6)."""
    alone = SimpleNamespace(
        families=(slice(0, 6),),
        covariance=np.diag(STD**2),
        sigma=STD,
        row=None,
        row_variance=np.ones(6),
        judged=np.array([False, True, False, True]),
        y=np.array(y),
        count=np.array(count),
        block=np.arange(4),
        scatter=np.einsum("ki,ij->kij", scatter, np.eye(6)),
        moving=False,
        noise=noise,
        scene=SimpleNamespace(held=np.array([True, True, False, True, True])),
        averaged=averaged,
    )
    alone.leading = alone
    return alone


def test_a_gap_is_the_mean_square_over_noise_less_one_and_rows_that_scatter_add_to_it():
    reading, y = ZERO.copy(), ZERO[:4].copy()
    y[1], y[3] = 3.0 * STD, 1.0 * STD
    held_out = HeldOut(observed(y))
    assert held_out.count.sum() == 14
    assert held_out.of(reading) == pytest.approx([8.0, 0.0])
    assert np.average(held_out.of(reading), weights=held_out.count) == pytest.approx(8.0 * 4 / 14)
    assert held_out.channels(reading) == pytest.approx([8.0 * 4 / 14] * 6)
    reading[1], reading[4] = y[1], -y[3]  # of the judged poses; the last held row is the fifth
    assert held_out.of(reading) == pytest.approx([-1.0, 3.0])
    scatter = ZERO[:4].copy()
    scatter[1], scatter[3, 0] = STD**2, 3.0 * STD[0] ** 2  # the first: each row's own noise
    held_out = HeldOut(observed(scatter=scatter))
    assert held_out.of(ZERO) == pytest.approx([0.0, 0.5 - 1.0])
    assert held_out.channels(ZERO)[0] == pytest.approx((0.0 * 4 + 2.0 * 10) / 14)
    assert held_out.channels(ZERO)[1] == pytest.approx((0.0 * 4 - 1.0 * 10) / 14)
    p = observed()
    p.covariance, p.sigma = np.eye(6), np.ones(6)
    p.covariance[0, 1] = p.covariance[1, 0] = 0.6
    p.y[1, :2] = 1.0
    expected = np.ones(2) @ np.linalg.inv(p.covariance[:2, :2]) @ np.ones(2) / 6 - 1.0
    assert HeldOut(p).of(ZERO)[0] == pytest.approx(expected)


def test_the_floor_is_what_rows_scatter_with_the_mean_s_degree_of_freedom_back():
    scatter = np.outer([0.0, 0.75, 0.0, 1.8], STD**2)
    # of 4 rows: 0.75 · 4 / 3 = 1; of 10 rows: 1.8 · 10 / 9 = 2
    assert HeldOut(observed(scatter=scatter)).floor() == pytest.approx([0.0, 1.0])
    # one row shows no scatter; two of 1.8 · 2
    few = observed(scatter=scatter, count=(1, 1, 1, 2))
    assert HeldOut(few).floor() == pytest.approx([0.0, 2.6])
    moved = observed(averaged=True, noise=np.array([1.0, 2, 3, 1, 2, 3]))
    assert HeldOut(moved).floor() == pytest.approx([1.0, 1.0])  # the noise of averages


def drawn(count, block, seed=0):
    """A bootstrap over observations of so many rows in these blocks."""
    return Bootstrap([(np.array(block), np.array(count))], seed)


def ones(n):
    return np.ones(n, dtype=int)


def test_means_weigh_rows_and_ratios_are_of_sums_and_intervals_draw_blocks():
    blocks, gaps = drawn([1, 1, 2], [0, 7, 7]), np.array([5.0, 9.0, 3.0])
    mean = blocks.mean(gaps)
    assert mean.value == pytest.approx((5.0 + 9.0 + 2 * 3.0) / 4)
    # of draws of two blocks: only the first, only the second, or both
    assert (mean.low, mean.high) == pytest.approx(((9.0 + 2 * 3.0) / 3, 5.0))
    assert blocks.mean(gaps) == mean == drawn([1, 1, 2], [0, 7, 7]).mean(gaps)
    ratio = blocks.ratio(np.array([4.0, 4.0, 6.0]), np.array([4.0, 8.0, 8.0]))
    assert ratio.value == pytest.approx((4.0 + 4.0 + 2 * 6.0) / (4.0 + 8.0 + 2 * 8.0))
    assert (ratio.low, ratio.high) == pytest.approx((16 / 24, 1.0))


def test_intervals_draw_blocks_of_rows_together():
    """Four blocks of 25 equal rows know as much as four rows."""
    gain = np.repeat([0.0, 1.0, 2.0, 3.0], 25)
    together, single = drawn(ones(100), np.arange(100) // 25), drawn(ones(100), np.arange(100))
    interval = together.mean(gain)
    assert (interval.low, interval.high) == pytest.approx((0.5, 2.5), abs=0.26)
    interval = single.mean(gain)
    assert interval.high - interval.low == pytest.approx(2 * 1.96 * gain.std() / 10.0, rel=0.1)
    # drawn from a few blocks at one end they would be alike
    half = drawn(ones(40), np.arange(40)).mean(np.repeat([0.0, 1.0], 20))
    assert 0.3 < half.low < 0.42 and 0.58 < half.high < 0.7  # 0.5 ∓ 1.96 · 0.5/√40
    few, many = ((np.arange(10), np.full(10, k)) for k in (1, 3))
    told = Bootstrap([few, many], 0).mean(np.repeat([1.0, 0.0], 10))
    assert told.value == 0.25
    assert told.low < 0.2 < 0.3 < told.high  # ten blocks alone would have no spread
    blocks = drawn([1, 1], [0, 1])
    assert blocks.ratio(np.ones(2), np.zeros(2)) is None
    told = blocks.ratio(np.array([2.0, -1.0]), np.array([2.0, -1.0]))
    assert told.value == pytest.approx(1.0)  # draws of the second block alone: none
    assert np.isfinite([told.low, told.high]).all()


def closure_of(members, closed, floor=0.5):
    """Gaps of a diagnosis whose causes close so much each."""
    at = {k: Interval(v, v - 0.1, v + 0.1) for k, v in members.items()}
    share = None if closed is None else Interval(closed, closed - 0.1, closed + 0.1)
    before = Interval(6.0, 4.0, 8.0)
    return Closure(9.0, before, None, floor, share, None, 40, 4, {}, at, {})


def test_the_closed_share_is_split_by_what_comes_back_without_each():
    made = {"base.tilt": 3.0, "cable.pull": 1.0, "tool.loose": -2.0}
    told = closure_of(made, 0.8).shares
    assert told == pytest.approx({"base.tilt": 0.6, "cable.pull": 0.2, "tool.loose": 0.0})
    assert closure_of({"tool.loose": -2.0}, 0.8).shares == {"tool.loose": 0.0}
    assert closure_of(made, None).shares == pytest.approx(dict.fromkeys(made, 0.0))
    assert closure_of({}, None).excess == pytest.approx(5.5)
    assert closure_of({}, None, floor=-0.2).excess == pytest.approx(6.0)  # no noise is below none
    of = closure_of({"tool.slide": 4.0}, 0.65, floor=0.2)
    surely, perhaps = Interval(3.3, 1.3, 4.9), Interval(3.3, 1.1, 4.9)
    assert replace(of, with_effects=surely).closed_beside(1.0) == 0.65
    assert replace(of, with_effects=perhaps).closed_beside(1.0) == 1.0
    assert replace(closure_of({}, None), with_effects=surely).closed_beside(1.0) == 1.0
    assert of.closed_beside(1.0) == 1.0


def nominal(robot):
    model = Model.of(registry.load("robots", robot))
    return Configuration(model, model.parameters.nominal + 0.0)


@pytest.mark.parametrize("robot", ["ur5", "oriented"])
def test_a_tool_beside_a_cause_is_never_lighter_than_nothing(robot):
    """Seen: `diagnose` of a real 7-joint arm ended at a mass of −0.37 kg, an error."""
    stated = nominal(robot)
    of = {"sensor.bias": slice(0, 6), "tool.mass": slice(6, 7), "tool.cog": slice(7, 10)}
    d = SimpleNamespace(of_stated=of.get, size=np.ones(10), stated=np.arange(10))
    error = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, -stated.mass - 0.37, 0.0, 0.0, 0.3])
    moved = moved_by(SimpleNamespace(d=d), error, stated)
    assert 0.0 < moved.mass < 1e-3
    assert moved.bias == pytest.approx([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    assert moved.cog == pytest.approx(stated.cog + np.array([0.0, 0.0, 0.3]))


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("tool.mass", (0.9, 0.1, 1.0)),
        ("tool.cog", (1.4, 0.0, 1.0)),
        ("sensor.bias", (1.4, 0.1, 0.0)),
        ("base.tilt", (1.4, 0.1, 1.0)),
    ],
)
def test_one_number_alone_goes_back_to_what_is_stated(name, expected):
    stated = nominal("ur5").with_load(0.9, np.zeros(3), np.zeros(6))
    now = nominal("ur5").with_load(1.4, np.array([0.0, 0.0, 0.1]), np.ones(6))
    told = restored(now, stated, name)
    assert (told.mass, float(told.cog[2]), float(np.mean(told.bias))) == pytest.approx(expected)


FOLD = 2


D = dictionary(moving=False)
IN_FOLD = np.repeat(np.arange(ROWS) // 5 % 4 == FOLD, 6)


def by_hand(f, y, rows):
    """The most probable variables (k,) of a finalist on some rows, all matrices dense."""
    level = Searcher(D).levels[f.rung]
    E, v0 = D.E[rows], level.v0[rows]
    K = np.diag(v0) + (E * level.V) @ E.T
    X = np.concatenate([D.E[:, h.columns] for h in f.parts], axis=1)[rows]
    inner = X.T @ np.linalg.solve(K, X) + np.diag(1.0 / f.spread[: X.shape[1]] ** 2)
    return np.linalg.solve(inner, X.T @ np.linalg.solve(K, y[rows]))


@pytest.mark.parametrize("names", [("base.tilt",), ("cable.pull", "joint.offset")])
def test_a_refit_without_a_fold_is_that_of_the_other_rows(names):
    y = readings(D, dict.fromkeys(names, 9.0))
    r = refitter(D, y)
    f = r.fit(named(D, *names), 0)
    again = r.without(FOLD).again(f)
    assert again.x == pytest.approx(by_hand(f, y, ~IN_FOLD), abs=1e-4)
    X = np.concatenate([D.E[:, h.columns] for h in f.parts], axis=1)
    predicted = X[IN_FOLD] @ again.x
    assert predicted == pytest.approx(X[IN_FOLD] @ by_hand(f, y, ~IN_FOLD), abs=1e-3)
    assert again.residual == pytest.approx((y - X @ again.x)[~IN_FOLD])
    assert np.abs(again.x - f.x).max() > 1e-3  # the fold does tell something


@pytest.fixture(scope="module")
def prepared():
    truth = {k: v for k, v in UR5_TRUTH.items() if not k.startswith("mount")}
    rec = static("ur5", truth, poses=40, samples=10, noise=WHITE)
    return prepare(with_tool(rec, 1.4, 0.007, -0.002, 0.083))


def analysed(prepared) -> Analysis:
    """Without the search: its ranking plays no part here."""
    baseline = calibrate(prepared)
    d = build_dictionary(prepared, baseline.robot_theta, baseline.tolerance)
    r = Refitter(Searcher(d), readings_from_baseline(d, prepared, baseline))
    return Analysis(prepared, baseline, r.searcher, r, None, r)


def tilted(prepared, size=0.01):
    """The same with the readings of a base tilted about x [rad]."""
    effect = effects()["base.tilt"]
    active = ActiveEffect(effect, {"x": size, "y": 0.0})
    more = respond(prepared.scene, [active]) - prepared.expected
    return replace(prepared, y=prepared.y + more[prepared.scene.held])


def spoiled(prepared, fold, sigmas=5.0):
    """The same with other readings in one fold."""
    push = sigmas * prepared.sigma * np.random.default_rng(1).standard_normal(prepared.y.shape)
    return replace(prepared, y=prepared.y + push * (prepared.fold == fold)[:, None])


def with_tilt(a: Analysis) -> tuple[CrossFit, Claimed]:
    h = next(h for h in a.dictionary.hypotheses if h.name == "base.tilt" and len(h.columns) == 2)
    fits = CrossFit(a, {k: a.refitter.without(k) for k in a.prepared.folds})
    return fits, Claimed(a.refitter.fit((h,), 0), (0,), ())


def test_a_calibration_without_a_fold_is_least_squares_on_the_others(prepared):
    """Readings are linear in mass, mass times CoG and bias: numpy fits them for each fold."""
    p, a = prepared, analysed(prepared)
    told = CrossFit(a, {}).calibrated()[p.scene.held]
    stated = p.configuration

    def read(mass, moment):
        c = stated.with_load(mass, np.asarray(moment) / mass, np.zeros(6))
        at = replace(p, scene=replace(p.scene, theta=c.robot_theta))
        return c.model.read(at.expected, c.theta)[p.scene.held]

    zero = 2.0 * read(1.0, np.zeros(3)) - read(2.0, np.zeros(3))
    columns = [read(1.0, np.zeros(3)) - zero]
    columns += [(read(1.0, 0.1 * e) - read(1.0, np.zeros(3))) / 0.1 for e in np.eye(3)]
    columns += [np.ones((40, 1)) * e for e in np.eye(6)]
    X = np.stack([(c / p.sigma).ravel() for c in columns], axis=1)
    y, fold = ((p.y - zero) / p.sigma).ravel(), np.repeat(p.fold, 6)
    for k in p.folds:
        fitted = np.linalg.lstsq(X[fold != k], y[fold != k], rcond=None)[0]
        by_hand = (X @ fitted).reshape(-1, 6) + zero / p.sigma
        assert (told / p.sigma)[p.fold == k] == pytest.approx(by_hand[p.fold == k], abs=0.01)
    everywhere = (X @ np.linalg.lstsq(X, y, rcond=None)[0]).reshape(-1, 6) + zero / p.sigma
    assert np.abs(told / p.sigma - everywhere).max() > 0.05


def test_no_simulator_has_seen_the_fold_that_it_is_read_on(prepared):
    sound = tilted(prepared)
    told, first = [], None
    for p in (sound, spoiled(sound, FOLD)):
        a = analysed(p)
        fits, claim = with_tilt(a)
        first = first or claim.finalist
        prior = {"spread": first.spread, "rung": first.rung}  # all rows may say how large
        claim = claim._replace(finalist=replace(claim.finalist, **prior))
        after, without = fits.explained(claim)
        read = (fits.calibrated(), after, without["base.tilt"])
        told.append([x[p.scene.held] / p.sigma for x in read])
        told[-1].append(twin_of(a, claim).wrench(p.scene)[p.scene.held] / p.sigma)
    own, others = sound.fold == FOLD, sound.fold != FOLD
    (*before, seen), (*after, seen_then) = told
    assert np.abs(seen_then - seen)[own].max() > 0.1  # fitted on all rows: it did
    for x, y in zip(before, after, strict=True):
        assert y[own] == pytest.approx(x[own], abs=0.03)
        assert np.abs(y - x)[others].max() > 0.1


def test_a_named_effect_is_back_in_the_gap_without_it(prepared):
    a = analysed(tilted(prepared))
    fits, claim = with_tilt(a)
    after, without = fits.explained(claim)
    p, held = a.prepared, a.prepared.scene.held
    assert np.sqrt((((p.y - after[held]) / p.sigma) ** 2).mean()) < 0.5  # noise of ten rows' mean
    effect = ActiveEffect(effects()["base.tilt"], {"x": 0.01, "y": 0.0})
    made = (respond(p.scene, [effect]) - p.expected)[held] / p.sigma
    back = (after - without["base.tilt"])[held] / p.sigma
    assert back == pytest.approx(made, abs=0.1 * np.abs(made).max())
