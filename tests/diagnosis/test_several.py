"""One and several recordings of one robot: exact sums by hand, and robots whose truth is known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

import wrenchbed as wb
from altered import with_metadata
from linear_case import dictionary, named, noise, refitter
from simulated import driven
from wrenchbed.diagnosis.evidence.likelihood import BackgroundLevel, Moments, over_scales
from wrenchbed.diagnosis.explain.fit_of_several_recordings import Structure
from wrenchbed.diagnosis.explain.refit import together
from wrenchbed.diagnosis.explain.verdict import Cause, Part
from wrenchbed.diagnosis.several import check, settles
from wrenchbed.errors import DiagnosisError


def recorded(tmp_path, *effects, n=40, seed=1):
    plan = wb.poses(wb.load("robots", "ur5"), n, seed)
    return driven(plan, tmp_path / "rec.parquet", 30, noise="white", seed=seed, effects=effects)


TILT, PULL, LOOSE = "base.tilt", "cable.pull", "tool.loose"


def joint(*cases):
    """Refitters of linear recordings (dictionary, readings), fitted together."""
    return together([refitter(d, y) for d, y in cases])


def fit(j, name):
    return j[0].fit(named(j[0].d, name), j[0].nothing().rung)


def signal(d, name, amplitude):
    return amplitude * d.E[:, [e for e, _ in d.label].index(name)]


def test_the_evidence_of_two_recordings_is_that_of_both_stacked():
    rng = np.random.default_rng(1)
    E, y = rng.standard_normal((2, 12, 3)), rng.standard_normal((2, 12))
    levels = [
        BackgroundLevel(e, np.full(12, v), np.full(3, 0.2))
        for e, v in zip(E, (1.0, 2.0), strict=True)
    ]
    columns = rng.standard_normal((2, 12, 2))
    each = zip(levels, columns, y, strict=True)
    both = [Moments.of(v, v.whitened(np.column_stack([c, z]))) for v, c, z in each]
    told = over_scales(both[0] + both[1], np.zeros(2, int), np.zeros(2), np.array([[0.7]])).total
    noise_of = [np.eye(12) * v + 0.2 * e @ e.T for e, v in zip(E, (1.0, 2.0), strict=True)]
    stacked = 0.49 * np.concatenate(columns) @ np.concatenate(columns).T
    stacked[:12, :12] += noise_of[0]
    stacked[12:, 12:] += noise_of[1]
    exact = multivariate_normal(np.zeros(24), stacked).logpdf(np.concatenate(y))
    assert told == pytest.approx(exact + 12.0 * np.log(2.0 * np.pi))


def test_numbers_of_the_robot_are_shared_and_those_of_a_recording_its_own():
    d = dictionary()
    parts = named(d, TILT, "sensor.bias", LOOSE)
    cases = [refitter(d, noise(d, k)) for k in range(2)]
    s = Structure(cases, [parts, parts])
    assert s.sets == ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1))
    assert s.free == 4 and [at.tolist() for at in s.at] == [[0, 1, 2], [0, 1, 3]]
    assert s.owner.tolist() == [0, 0, 3, 4, *[1] * 6, *[2] * 6]
    assert [b.tolist() for b in s.blamed] == [[*range(4, 10)], [*range(10, 16)]]
    x = np.array([1.0, 2.0, 3.0, 4.0])
    first, second = s.response(x).reshape(2, -1)
    assert first == pytest.approx(cases[0].response(parts, x[:3]))
    assert second == pytest.approx(cases[1].response(parts, x[[0, 1, 3]]))
    assert s.merged([x[:3] + 1.0, x[[0, 1, 3]]], last=1).tolist() == [1.0, 2.0, 4.0, 4.0]

    def fitted(name, *amplitudes):
        return fit(joint(*((d, signal(d, name, a) + noise(d, k)) for k, a in amplitudes)), name)

    agree, contradict = (fitted(TILT, (0, 1.0), (1, a)) for a in (1.0, -1.0))
    for f in (agree, contradict):
        assert f.each[0].x.tolist() == f.each[1].x.tolist()
    assert contradict.log_posterior < agree.log_posterior - 50.0
    own = fitted(LOOSE, (0, 1.0), (1, -1.0))
    assert [float(v.x[0]) for v in own.each] == pytest.approx([1.0, -1.0], abs=0.1)
    same = fitted(LOOSE, (0, 1.0), (1, 1.0))
    assert own.log_posterior == pytest.approx(same.log_posterior, abs=1.0)


def test_one_recording_is_the_least_of_several_and_a_fold_of_each_is_held_out():
    d = dictionary()
    alone = refitter(d, signal(d, LOOSE, 1.0) + noise(d))
    (one,) = together([alone])
    for name in (TILT, LOOSE, "sensor.bias"):
        f, g = (r.fit(named(d, name), 0) for r in (alone, one))
        assert (f.x == g.x).all() and f.log_posterior == g.log_posterior
    j = joint((d, signal(d, TILT, 1.0) + noise(d)), (d, signal(d, TILT, 1.0) + noise(d, 1)))
    f = fit(j, TILT)
    less = j[0].without(1)
    assert [len(r.y) for r in less.each] == [len(d.E) * 3 // 4] * 2
    assert less.again(f) is less.each[1].again(f.each[1]).each[0]  # one fit to both
    again, kept = j[1].again(f.each[1]), j[1].keeping(f.each[1], [0])
    assert again.x == pytest.approx(f.x, abs=0.01)  # another prior
    assert kept.names == f.names and kept.residual == pytest.approx(again.residual, abs=1e-6)


def test_what_a_first_recording_cannot_tell_a_second_one_tells():
    alike = dictionary(alike={(TILT, PULL): 0.99999})
    other = dictionary()
    y = [signal(d, TILT, 1.0) + noise(d, k) for k, d in enumerate((alike, other))]
    one = joint((alike, y[0]))
    two = joint((alike, y[0]), (other, y[1]))
    assert abs(fit(one, TILT).log_posterior - fit(one, PULL).log_posterior) < 2.0
    told = fit(two, TILT)
    assert told.log_posterior > fit(two, PULL).log_posterior + 100.0
    assert told.x[0] == pytest.approx(1.0, abs=0.05) and len(told.x) == 2
    for view in told.each:
        assert view.x.tolist() == told.x.tolist()


def test_other_robots_and_the_same_rows_twice_are_refused(tmp_path):
    a = recorded(tmp_path, n=12)
    b = replace(a, name="b.parquet", columns=a.columns | {"fx": a.columns["fx"] + 1.0})
    check([a, b])
    other = with_metadata(b, robot="medrue")
    with pytest.raises(DiagnosisError, match=r"b\.parquet: metadata robot = 'medrue', but .*'ur5'"):
        check([a, other])
    upright, turned = (with_metadata(r, gravity=(0, 0, g)) for r, g in ((a, -9.81), (b, 9.81)))
    with pytest.raises(DiagnosisError, match=r"b\.parquet: metadata gravity"):
        check([upright, turned])
    with pytest.raises(DiagnosisError, match="row by row"):
        check([a, replace(a, name="copy.parquet")])
    with pytest.raises(DiagnosisError, match="two or more"):
        check([a])


@pytest.mark.slow
def test_two_recordings_of_a_tilted_base_are_one_answer(tmp_path):
    tilt = "base.tilt:x=0.006,y=-0.004"
    each = (recorded(tmp_path, tilt, n=n, seed=seed) for n, seed in ((30, 1), (24, 2)))
    a, b = (replace(r, name=f"{name}.parquet") for r, name in zip(each, "ab", strict=True))
    alone, found = wb.diagnose(a), wb.diagnose_several([a, b])
    told = found.diagnosis.to_json()
    (cause,) = told["which"]
    (before,) = alone.diagnosis.to_json()["which"]
    assert told["verdict"] == "identified" and cause["effect"] == "base.tilt"
    for axis, true in (("x", 0.006), ("y", -0.004)):
        p = cause["parameters"][axis]
        assert abs(p["value"] - true) < 4 * p["std"] + 1e-5
        assert p["std"] < before["parameters"][axis]["std"]  # both recordings measure it
    assert told["recordings"] == ["a.parquet", "b.parquet"] and told["recording"] == "a.parquet"
    assert told["gap"]["held_out_rows"] == 30 * (30 + 24)
    assert told["gap"]["closed"] > 0.95 and cause["probability"] > 0.9
    assert told["where"][0]["subsystem"] == "base"
    assert [a.effect.name for a in found.diagnosis.twin.active] == ["base.tilt"]
    assert any(n.startswith("b.parquet: 24 poses") for n in found.diagnosis.notes)


def test_what_the_second_recording_settles_is_said():
    cause = Cause(((TILT, None), (PULL, None)), 0.9, Part(TILT, 2.0), (0.5, 0.5))
    alone = SimpleNamespace(causes=(cause,))
    now = SimpleNamespace(names=(TILT,), probability=0.97)
    both = SimpleNamespace(causes=(now,))
    (text,) = settles(alone, both, ["a.parquet", "b.parquet"])
    assert text == "b.parquet tells base.tilt from cable.pull: probability 0.45 → 0.97"
    still = SimpleNamespace(causes=(cause,))
    assert settles(alone, still, ["a.parquet", "b.parquet"]) == []
