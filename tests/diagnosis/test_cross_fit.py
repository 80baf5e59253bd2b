"""A fold is judged by fits that did not see it: by hand, and with its readings changed."""

from dataclasses import replace

import numpy as np
import pytest

from linear_case import ROWS, dictionary, named, readings, refitter
from simulated import UR5_TRUTH, WHITE, static, with_tool
from wrenchbed.diagnosis.evidence.search import Searcher
from wrenchbed.diagnosis.explain.refit import Refitter
from wrenchbed.diagnosis.explain.structures import Analysis, case
from wrenchbed.diagnosis.explain.structures import build as build_dictionary
from wrenchbed.diagnosis.gap.closure import Claimed, calibrated, twin_of
from wrenchbed.diagnosis.gap.held_out import CrossFit
from wrenchbed.diagnosis.prepare.baseline import calibrate
from wrenchbed.diagnosis.prepare.prepare_recording import prepare
from wrenchbed.effects.chain import ActiveEffect, effects, respond

FOLD = 2


# ---- where all is linear -----------------------------------------------------------------------

D = dictionary(moving=False)
IN_FOLD = np.repeat(np.arange(ROWS) // 5 % 4 == FOLD, 6)


def by_hand(f, y, rows):
    """The most probable variables (k,) of a finalist on some rows, all matrices dense."""
    level = Searcher(D).rungs[f.rung].level
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


# ---- a robot -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def prepared():
    truth = {k: v for k, v in UR5_TRUTH.items() if not k.startswith("mount")}
    rec = static("ur5", truth, poses=40, samples=10, noise=WHITE)
    return prepare(with_tool(rec, 1.4, 0.007, -0.002, 0.083))


def analysed(prepared) -> Analysis:
    """Without the search: its ranking plays no part here."""
    baseline = calibrate(prepared)
    d = build_dictionary(prepared, baseline.robot_theta, baseline.tolerance)
    r = Refitter(Searcher(d), case(d, prepared, baseline))
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


def with_tilt(a: Analysis) -> Claimed:
    h = next(h for h in a.dictionary.hypotheses if h.name == "base.tilt" and len(h.columns) == 2)
    f = a.refitter.fit((h,), 0)
    return Claimed(twin_of(a, f, [0]), f, (0,), ())


def test_a_calibration_without_a_fold_is_least_squares_on_the_others(prepared):
    """Readings are linear in mass, mass times CoG and bias: numpy fits them for each fold."""
    p, a = prepared, analysed(prepared)
    told = CrossFit(a).calibrated(calibrated(a))[p.scene.held]
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
        fits, claim = CrossFit(a), with_tilt(a)
        first = first or claim.finalist
        prior = {"spread": first.spread, "rung": first.rung}  # all rows may say how large
        claim = replace(claim, finalist=replace(claim.finalist, **prior))
        after, without = fits.explained(claim.twin, claim.finalist, claim.keep, claim.wrong)
        read = (fits.calibrated(calibrated(a)), after, without["base.tilt"])
        told.append([x[p.scene.held] / p.sigma for x in read])
        told[-1].append(claim.twin.wrench(p.scene)[p.scene.held] / p.sigma)
    own, others = sound.fold == FOLD, sound.fold != FOLD
    (*before, seen), (*after, seen_then) = told
    assert np.abs(seen_then - seen)[own].max() > 0.1  # fitted on all rows: it did
    for x, y in zip(before, after, strict=True):
        assert y[own] == pytest.approx(x[own], abs=0.03)
        assert np.abs(y - x)[others].max() > 0.1


def test_a_named_effect_is_back_in_the_gap_without_it(prepared):
    a = analysed(tilted(prepared))
    claim = with_tilt(a)
    after, without = CrossFit(a).explained(claim.twin, claim.finalist, claim.keep, claim.wrong)
    p, held = a.prepared, a.prepared.scene.held
    assert np.sqrt((((p.y - after[held]) / p.sigma) ** 2).mean()) < 0.5  # noise of ten rows' mean
    effect = ActiveEffect(effects()["base.tilt"], {"x": 0.01, "y": 0.0})
    made = (respond(p.scene, [effect]) - p.expected)[held] / p.sigma
    back = (after - without["base.tilt"])[held] / p.sigma
    assert back == pytest.approx(made, abs=0.1 * np.abs(made).max())
