"""A load, or a wrong torque sensor in motion, is named with its value, or is said to be fitted."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from arm_gaps import Gap, case, unstated
from arm_torques import COULOMB, MASS, NOISE, VISCOUS
from file_arms import IIWA, UR10
from file_arms import case as by_file

from wrenchbed.diagnosis.efforts.columns import of_arm
from wrenchbed.diagnosis.efforts.diagnose_efforts import diagnose_efforts
from wrenchbed.diagnosis.efforts.errors_of_fit import ERROR, errors_alone
from wrenchbed.diagnosis.efforts.fitted_causes import (
    ORDINARY,
    Simulator,
    Simulators,
    _gaps,
    added,
)
from wrenchbed.diagnosis.efforts.json_entries import _std_of_fit
from wrenchbed.diagnosis.efforts.scene import effort_scene
from wrenchbed.diagnosis.efforts.stated_drives import stated_drives, with_tool
from wrenchbed.drives.identify import calibrate_efforts
from wrenchbed.drives.ordinary_errors import of_link
from wrenchbed.effects.drives.base import Block
from wrenchbed.reports.effort_answer import EffortAnswer, effort_charts

pytestmark = pytest.mark.usefixtures("fresh_registry")
TEN = pytest.mark.parametrize("seed", range(10))


def claimed(found):
    return {entry["effect"]: entry for entry in found.diagnosis.which}


def holds(number, truth, most):
    """Whether a published number has the truth within 3 σ, and σ is at most ``most``."""
    return abs(number["value"] - truth) < 3.0 * number["std"] and number["std"] < most


@pytest.mark.slow
@TEN
@pytest.mark.parametrize("load", [0.8, 1.3, 1.8])
def test_a_payload_of_an_arm_whose_file_states_its_tool_is_named(tmp_path, load, seed):
    recording = by_file(IIWA, tmp_path, seed, seed, load, configured=IIWA.configured())
    found = claimed(diagnose_efforts(recording))
    assert set(found) == {"tool.mass"}
    assert holds(found["tool.mass"]["parameters"]["mass"], load, 0.15)


@pytest.mark.sampled
@TEN
@pytest.mark.parametrize("moved", [(0.024, 0.008, 0.0), (0.02, -0.11, 0.05)])
def test_a_heavier_tool_whose_centre_has_moved_is_two_wrong_numbers(seed, moved):
    gap = Gap("tool.mass", size=0.5, moved=moved)
    found = claimed(diagnose_efforts(case(gap, seed, links=True)))
    assert set(found) == {"tool.mass", "tool.cog"}
    assert holds(found["tool.mass"]["parameters"]["mass"], 0.5, 0.15)
    places = [found["tool.cog"]["parameters"][a] for a in "xyz"]
    assert all(holds(p, x, 0.006) and p["unit"] == "m" for p, x in zip(places, moved, strict=True))


@pytest.mark.sampled
@TEN
def test_a_load_beside_drives_of_a_healthy_fit_is_named_from_currents(tmp_path, seed):
    healthy = by_file(UR10, tmp_path, seed, 100 + seed, current=True)
    calibrate_efforts(healthy).write(tmp_path / "healthy.json")
    loaded = by_file(UR10, tmp_path, seed, seed, 2.8, current=True)
    answer = diagnose_efforts(loaded, drives=tmp_path / "healthy.json")
    found = claimed(answer)
    assert set(found) == {"tool.mass"}
    assert holds(found["tool.mass"]["parameters"]["mass"], 2.8, 0.15)
    assert "tool.mass" not in {n["name"] for n in answer.diagnosis.fitted}


def test_what_is_fitted_because_nobody_states_it_is_said():
    gap = Gap("tool.mass", size=0.9)
    found = diagnose_efforts(unstated(case(gap, 6, 30.0, configured=False, links=True)))
    words = EffortAnswer(found)
    assert found.diagnosis.verdict == "none" and found.diagnosis.gap.configured > 5.0
    (load,) = (n for n in found.diagnosis.fitted if n["name"] == "tool.mass")
    assert holds(load, MASS + gap.size, 0.15)
    assert "a load of 2.8" in words.headline and "robot's model has 1.35 kg" in words.headline
    assert "friction of joints 1, 2, 3, 4, 5 and 6" in words.headline
    advice = words.advice_without_experiment
    assert "all but noise" not in advice and "State tool" in advice
    stated = EffortAnswer(replace(found, diagnosis=replace(found.diagnosis, fitted=())))
    advice = stated.advice_without_experiment
    assert "normal imperfections" in stated.headline and "all but noise" in advice


@pytest.mark.slow
def test_what_a_healthy_fit_left_is_no_gap_on_another_day(tmp_path):
    """Joint 2 has a torque that follows joints 1 and 4, as no effect of the library does."""

    def day(seed, zero=0.0):
        quiet = by_file(replace(UR10, noise=UR10.noise / 5.0), tmp_path, 1, seed)
        bound = 2.0 * np.sin(3.0 * quiet.q[:, 0] + 2.0 * quiet.q[:, 3])
        changed = {"tau2": quiet.columns["tau2"] + bound, "tau4": quiet.columns["tau4"] + zero}
        return replace(quiet, columns=dict(quiet.columns) | changed)

    path = tmp_path / "healthy.json"
    calibrate_efforts(day(101)).write(path)
    same = diagnose_efforts(day(1), drives=path).diagnosis
    assert same.verdict == "none"
    assert any("tau2" in n and "the noise is what the healthy" in n for n in same.notes)
    found = claimed(diagnose_efforts(day(1, zero=2.0), drives=path))
    assert set(found) == {"drive.offset"} and found["drive.offset"]["probability"] > 0.95
    assert holds(found["drive.offset"]["parameters"]["offset"], 2.0, 0.05)


@pytest.mark.slow
def test_links_that_few_patterns_show_keep_near_their_ordinary_size(tmp_path):
    quiet = by_file(replace(IIWA, noise=IIWA.noise / 20.0), tmp_path, 1, 201)
    assert 0.4 < calibrate_efforts(quiet).link_errors < 1.0  # 0.17 by the residual alone


def test_an_error_that_would_move_another_stated_number_too_far_is_limited():
    """A number is held at its bound; another one, nearly alike, would have to make up for it."""
    rng = np.random.default_rng(0)
    a, held, unlike = rng.normal(size=(3, 500)) * 1e3
    columns = np.stack([a, held, 0.1 * held + 1e-3 * unlike], axis=1)
    std, x = np.array([0.0, 1.0, 0.2]), np.array([5.0, ORDINARY + 0.02, 0.0])
    products = columns.T @ columns, (columns.T @ (columns @ x))[:, None]
    d = SimpleNamespace(
        std=std, stated=std > 0.0, free=np.zeros(3, bool), at=(np.array([0]),),
        size=np.ones(3), without=lambda _: products,
    )  # fmt: skip
    fit = Simulator(d, (0,))
    assert fit.x[1] == ORDINARY and 0.0 < fit.x[2] < ORDINARY * std[2]
    assert np.abs(fit.errors[:, 1:] / std[1:]).max() <= ORDINARY + 1e-9  # 50 where unlimited


def test_a_centre_is_as_sure_as_the_mass_that_its_moment_is_divided_by():
    load, by_errors = np.array([[1.5, 0.0], [0.03, 0.0]]), {"tool.mass": np.array([0.0, 0.04])}
    drives = SimpleNamespace(load=load, by_errors=by_errors, scale=0.1, std={})
    d = SimpleNamespace(scene=SimpleNamespace(drives=drives))
    assert _std_of_fit(d, ("tool.cog", None), 0.03, "m") == pytest.approx(0.03 * 0.05 / 1.5)
    assert _std_of_fit(d, ("base.tilt", None), 0.03, "rad") == 0.0
    assert _std_of_fit(d, ("tool.mass", None), 0.4, "kg") == pytest.approx(0.05)


def test_of_two_causes_in_a_joint_the_one_that_alone_leaves_least_comes_first():
    """A clipped torque: a gain makes larger readings, since an offset makes up for its form."""
    total = np.linspace(-45.0, -3.0, 400)
    columns = np.stack([total, np.minimum(total + 18.0, 0.0), np.ones(400)], axis=1)
    y, stated = -columns[:, 1], np.array([False, False, True])
    products = 1e2 * columns.T @ columns, 1e2 * (columns.T @ y)[:, None]
    channel = SimpleNamespace(
        y=y, data=columns, use=np.ones(400, bool), at=np.arange(3), gram=columns.T @ columns / 400
    )
    d = SimpleNamespace(
        std=np.where(stated, 3.0, 0.0), stated=stated, free=np.zeros(3, bool), size=np.ones(3),
        at=(np.array([0]), np.array([1])), joint=np.zeros(3, int), without=lambda _: products,
        channels=(channel,), blocks=(Block("drive.constant", 1, False, ("a",)),
                                     Block("torque limit", 1, True, ("b",))),
    )  # fmt: skip
    gaps = _gaps(Simulators(d), (0, 1))
    assert gaps[1] > 100.0 and gaps[0] < 1e-3
    assert added(d, Simulator(d, (0,)).x, d.at[0]) > gaps[1]  # by size the gain came first


@pytest.mark.slow
def test_a_centre_that_no_tool_has_does_not_stop_the_answer(monkeypatch):
    module = diagnose_efforts.__wrapped__.__globals__
    monkeypatch.setitem(module, "displacement", lambda d: np.full(3, 9.0))
    assert diagnose_efforts(case()).diagnosis.verdict == "none"


@pytest.mark.slow
def test_a_load_that_was_fitted_is_not_drawn_as_friction():
    found = diagnose_efforts(unstated(case(Gap("drive.coulomb", 2, 8.0), 7)))
    (chart,) = (c for c in effort_charts(found) if c.name == "friction-2")
    measured = chart.panels[0].series[0]
    level = COULOMB[1] + 8.0 * NOISE[1]
    fast = np.abs(measured.x) > 0.1
    expected = np.sign(measured.x) * level + VISCOUS[1] * measured.x
    assert np.abs(measured.y - expected)[fast].max() < 0.15 * level
    (efforts,) = (c for c in effort_charts(found) if c.name == "efforts")
    for above, beside in zip(efforts.panels[::2], efforts.panels[1::2], strict=True):
        measured, *predicted = above.series
        for series in predicted:  # none where a joint hardly moves, whose friction nobody knows
            assert np.nanmax(np.abs(series.y)) < 1.5 * np.abs(measured.y).max()
        assert any(np.isnan(series.y).any() for series in beside.series)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "joint", "gain", "zero"),
    [(2, 4, 0.0, 1.2), (3, 3, 0.1, 0.0), (1, 2, 0.0, 6.0), (4, 1, 0.0, -4.0), (6, 2, -0.15, 0.0),
     (7, 5, 0.0, 0.8)],
)  # fmt: skip
def test_a_wrong_sensor_is_named_with_its_value(seed, joint, gain, zero):
    rec, name = case(seed=seed, links=True), f"tau{joint}"
    read = (1.0 + gain) * rec.columns[name] + zero
    (only,) = diagnose_efforts(
        replace(rec, columns=dict(rec.columns) | {name: read})
    ).diagnosis.which
    assert only["effect"] == ("drive.constant" if gain else "drive.offset")
    assert only["parameters"]["joint"]["value"] == joint and not only["rivals"]
    number = only["parameters"]["gain" if gain else "offset"]
    assert abs(number["value"] - (gain or zero)) < 3.0 * number["std"] < abs(gain or zero)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_a_small_load_beside_a_healthy_fit_is_named(tmp_path, seed):
    calibrate_efforts(by_file(UR10, tmp_path, seed, 100 + seed)).write(tmp_path / "fit.json")
    loaded = by_file(UR10, tmp_path, seed, seed, 0.25)
    found = claimed(diagnose_efforts(loaded, drives=tmp_path / "fit.json"))
    assert set(found) == {"tool.mass"} and found["tool.mass"]["probability"] > 0.85
    assert holds(found["tool.mass"]["parameters"]["mass"], 0.25, 0.04)


def test_links_beside_what_they_changed_in_the_healthy_fit_predict_its_motion(tmp_path):
    healthy, path = by_file(UR10, tmp_path, 1, 101), tmp_path / "healthy.json"
    calibrate_efforts(healthy).write(path)
    fit = json.loads(path.read_text())
    for part in ("parameters", "by_errors"):
        fit[part]["drive.offset.99"] = fit[part]["drive.offset.1"]
    path.write_text(json.dumps(fit))
    drives = stated_drives(healthy, path)
    assert "drive.offset.1" in drives.by_errors and "drive.offset.99" not in drives.by_errors
    scene = effort_scene(with_tool(healthy, drives), drives)
    alone, left = errors_alone(scene), {}
    for column in (c for c in of_arm(scene)[0] if c.name.startswith(ERROR)):
        number = int(column.name.removeprefix(ERROR))
        each = alone[..., number], column.data
        before, after = (np.std(scene.thin(x)[scene.moving()]) for x in each)
        left[number] = after / before
    masses, links = [of_link(k)[0] for k in (2, 3, 4)], len(scene.inertias.phi)
    gains = [n for n in left if n >= 4 * links + scene.joints]  # friction: rows near rest are out
    assert len(gains) == scene.joints and max(left[k] for k in masses) < 0.25
    assert max(left[k] for k in (*gains, *(n for n in left if n < 4 * links))) < 0.9
    assert not set(left) & set(of_link(scene.robot.carrier))
