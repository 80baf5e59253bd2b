"""A nonlinear refit finds amplitude and shape of a known signal, with their uncertainty."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from linear_case import Named, dictionary, noise
from wrenchbed import registry
from wrenchbed.benchmark.lookalikes import ExperimentDesign, draw, recording
from wrenchbed.diagnosis.evidence.dictionary import Hypothesis, build
from wrenchbed.diagnosis.evidence.search import Searcher
from wrenchbed.diagnosis.explain import structures
from wrenchbed.diagnosis.explain.finalist import Variables
from wrenchbed.diagnosis.explain.refit import Refitter
from wrenchbed.diagnosis.prepare.bias_and_load_fit import calibrate
from wrenchbed.diagnosis.prepare.prepare_recording import prepare
from wrenchbed.effects.base import Variant
from wrenchbed.physics.model_parameters import Parameter
from wrenchbed.planning.choose import poses

NAME = "sensor.temperature"


@dataclass(frozen=True)
class Shaped(Named):
    """An effect with an amplitude [N] and a shape [s] of typical size 0.5 between 1 and 3."""

    def parameters(self, robot):
        return [
            Parameter("span", 0.0, "N", 0.2, -9.0, 9.0, ""),
            Parameter("lag", 2.0, "s", 0.5, 1.0, 3.0, ""),
            Parameter("held", 7.0, "1", 1.0, 0.0, 9.0, ""),
        ]


class Waving(Refitter):
    """A response that is not linear in its shape: amplitude times a wave of that lag."""

    def response(self, parts, x):
        if not parts:
            return np.zeros(len(self.y))
        (given,) = self.values(parts, x)
        return given["span"] / 0.2 * wave(len(self.y), given["lag"])


def wave(n, lag):
    return 2.0 * np.sqrt(2.0) * np.cos(lag * np.linspace(0.0, 6.0, n) + 0.3)


def case(amplitude, lag, seed=0):
    """A refitter of a wave in noise, and the hypothesis of a wave with a lag of 2 s."""
    d = dictionary(effects={NAME: 1})
    column = [e for e, _ in d.label].index(NAME)
    d.E[:, column] = wave(len(d.E), 2.0)
    d = replace(d)  # what it computed of its columns, again
    variant = Variant("lag", ("span",), {"lag": 2.0}, ("lag",))
    h = Hypothesis(Shaped(NAME), variant, np.array([column]), 4.0)
    d = replace(d, hypotheses=(*d.hypotheses[:3], h))
    y = amplitude * wave(len(d.E), lag) + noise(d, seed)
    return Waving(Searcher(d), y), h


def test_values_are_si_and_shapes_stay_within_their_bounds():
    r, h = case(1.0, 2.0)
    variables = Variables((h,))
    assert variables.name == ("span", "lag")
    assert variables.part.tolist() == [0, 0] and variables.shape.tolist() == [False, True]
    assert r.start((h,)) == pytest.approx([0.0, 4.0])  # 2 s in units of 0.5 s
    for x, lag in ((4.6, 2.3), (1.0, 1.0), (9.0, 3.0)):
        (told,) = r.values((h,), np.array([1.5, x]))
        assert told == pytest.approx({"span": 0.3, "lag": lag, "held": 7.0})
    stated = r.d.hypotheses[1]
    beside = Variables((stated, h))  # a stated number has no variables
    assert len(beside) == 2 and beside.of_parts([1]).tolist() == [0, 1]
    assert beside.of_parts([0]).tolist() == []


@pytest.mark.parametrize("lag", [2.0, 2.15, 1.85])
def test_amplitude_and_shape_are_found(lag):
    r, h = case(1.2, lag)
    f = r.fit((h,), 0)
    (told,) = r.values((h,), f.x)
    assert told["span"] == pytest.approx(1.2 * 0.2, rel=0.06)
    assert told["lag"] == pytest.approx(lag, abs=0.015)
    assert f.residual @ f.residual < 1.1 * len(r.y)
    std = np.sqrt(np.diagonal(f.covariance))
    assert abs(f.x[0] - 1.2) < 4.0 * std[0] < 0.5
    assert abs(f.x[1] - lag / 0.5) < 4.0 * std[1] < 0.3
    assert f.spread[1] == 2.0


def test_slopes_of_shapes_are_differences_and_those_of_plain_amplitudes_the_dictionary_s():
    r, h = case(1.0, 2.0)
    x = np.array([1.0, 4.0])
    told = r.design((h,), x, r.response((h,), x), range(2))
    assert told[:, 0] == pytest.approx(wave(len(r.y), 2.0))
    n = np.linspace(0.0, 6.0, len(r.y))
    slope = -2.0 * np.sqrt(2.0) * np.sin(2.0 * n + 0.3) * n * 0.5
    assert told[:, 1] == pytest.approx(slope, abs=0.3)
    plain = Hypothesis(h.effect, Variant("plain", ("span",), {"lag": 2.0}), h.columns, 4.0)
    told = r.design((plain,), np.array([1.0]), r.y, [0])
    assert (told[:, 0] == r.d.E[:, h.columns[0]]).all()


def test_the_linearised_data_is_what_is_left_and_what_the_slopes_make():
    r, h = case(1.2, 2.1)
    f = r.fit((h,), 0)
    assert f.y == pytest.approx(f.residual + f.design @ (f.x - np.array([0.0, 4.0])))
    assert f.residual == pytest.approx(r.y - r.response((h,), f.x))
    level = r.searcher.levels[f.rung]
    inner = f.design.T @ level.solve(f.design) + np.diag(1.0 / f.spread**2)
    assert f.covariance == pytest.approx(np.linalg.inv(inner), rel=1e-6)


@pytest.fixture(scope="module")
def refitter():
    robot = registry.load("robots", "ur5")
    design = ExperimentDesign.of_plan(poses(robot, 30, 3), robot)
    prepared = prepare(recording(design, draw(design, 4, "single", "sensor.drift")))
    baseline = calibrate(prepared)
    d = build(prepared, baseline.robot_theta, baseline.tolerance)
    return Refitter(Searcher(d), structures.readings_from_baseline(d, prepared, baseline))


def shaped(hypotheses, name):
    """The hypothesis of an effect with most amplitudes, one with shapes if there is such."""
    of = [h for h in hypotheses if h.name == name]
    return max(of, key=lambda h: (bool(h.variant.shape), len(h.variant.free)))


@pytest.mark.sampled
@pytest.mark.parametrize(
    "names",
    [
        ("sensor.jump",),
        ("sensor.creep",),
        ("sensor.drift", "sensor.jump"),
        ("tool.loose", "sensor.hysteresis"),
        ("sensor.crosstalk", "sensor.jump"),  # mixes channels: not at once
    ],
)
def test_slopes_of_several_channels(monkeypatch, refitter, names):
    """At once they are those of one after the other, with fewer responses."""
    parts = tuple(shaped(refitter.d.hypotheses, name) for name in names)
    r, asked = refitter, []
    x = r.start(parts)
    x = np.where(x == 0.0, np.random.default_rng(1).uniform(0.5, 2.0, len(x)), x)
    f, respond = r.response(parts, x), r.response
    alone = np.column_stack([r.design(parts, x, f, [k]) for k in range(len(x))])
    monkeypatch.setattr(r, "response", lambda *given: asked.append(given) or respond(*given))
    assert r.design(parts, x, f, range(len(x))) == pytest.approx(alone)
    moved = sum(len(h.variant.free) + len(h.variant.shape) for h in parts if h.variant.shape)
    assert (len(asked) < moved) is ("sensor.crosstalk" not in names)


class Jumping(Waving):
    """A wave of one lag, and far away with any other, whatever the slope promises."""

    def response(self, parts, x):
        if not parts:
            return np.zeros(len(self.y))
        (given,) = self.values(parts, x)
        jump = 30.0 * (given["lag"] != 2.0)
        return given["span"] / 0.2 * wave(len(self.y), 2.0) + jump * wave(len(self.y), 3.0)


def test_a_shape_that_acts_by_jumps_does_not_stop_the_amplitudes():
    r, h = case(3.0, 2.0)
    f = Jumping(r.searcher, r.y).fit((h,), 0)
    np.testing.assert_allclose(f.x, [3.0, 4.0], atol=0.1)
