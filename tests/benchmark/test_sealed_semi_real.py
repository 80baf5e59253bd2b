"""Faults of the referee are added to real recordings, sealed and scored."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from ntnu import GRAVITY, STD, motion, static
from sealed_family import truthful
from wrenchbed.benchmark.frame import EFFECTS, true_numbers
from wrenchbed.benchmark.scoring.case_rows import Claim
from wrenchbed.benchmark.sealed import commitments, make, report
from wrenchbed.benchmark.sealed import score as scoring
from wrenchbed.benchmark.sealed.real import HostRecording, SemiRealFamily
from wrenchbed.benchmark.sealed.real_setting import setting_of
from wrenchbed.calibration.calibrate import identify
from wrenchbed.cli import main
from wrenchbed.data.metadata import SensorInfo
from wrenchbed.data.recording import Recording
from wrenchbed.errors import BenchmarkError, ParameterError
from wrenchbed.physics.wrench import CHANNELS

COUNT, SEED = 14, 8


@pytest.fixture(scope="module")
def at_rest():
    return HostRecording(setting_of(static()), noise_seed=(1, 2))


@pytest.fixture(scope="module")
def moving():
    return HostRecording(setting_of(motion(1)), noise_seed=(1, 2))


@pytest.fixture(scope="module")
def semi_real(tmp_path_factory):
    """Cases, answers and the recording that they were made of."""
    folder = tmp_path_factory.mktemp("semi")
    static().write(folder / "host.parquet")
    return (*made(folder, folder / "host.parquet"), folder / "host.parquet")


def made(folder, host):
    line = ["blind", "make", "--on", str(host), "--cases", str(COUNT), "--seed", str(SEED)]
    folders = ["--out", str(folder / "cases"), "--answers", str(folder / "answers")]
    assert main([*line, *folders, "--processes", "1"]) == 0
    return folder / "cases", folder / "answers"


def drawn(host, name, size=2.0, seed=0):
    return host.drawn(name, np.random.default_rng(seed), size)


def change(host, fault):
    return host.recorded([fault]).wrench - host.setting.recording.wrench


def load(recording):
    """Weight (N, 6) of the tool that fits best, by its mass and centre of gravity."""
    fit = identify(recording.rotation, recording.wrench, GRAVITY, 1.0 / STD**2)
    force = fit.mass * GRAVITY @ recording.rotation
    return np.concatenate([force, np.cross(fit.cog, force)], axis=1), fit


def named(true, stem):
    return np.array([true.get(f"{stem}.{c}", 0.0) for c in CHANNELS])


# ---- the law of a fault comes back ---------------------------------------------------------------


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_gain_adds_its_share_of_the_fitted_load(at_rest, seed):
    fault = drawn(at_rest, "sensor.gain", seed=seed)
    by_hand = load(static())[0] * named(fault.true, "gain")
    assert np.abs(by_hand).max() > 0.01
    assert change(at_rest, fault) == pytest.approx(by_hand, abs=1e-9)


def test_a_bias_adds_itself(moving):
    fault = drawn(moving, "sensor.bias")
    by_hand = named(fault.true, "bias")
    assert np.abs(by_hand).max() > 0.01
    assert change(moving, fault) == pytest.approx(np.tile(by_hand, (len(motion(1)), 1)), abs=1e-9)


def test_a_tilt_turns_gravity_in_the_wrench_and_in_the_accelerometer(at_rest):
    fault, real = drawn(at_rest, "base.tilt"), static()
    turn = Rotation.from_rotvec([fault.true["x"], fault.true["y"], 0.0])
    pull = (turn.apply(GRAVITY) - GRAVITY) @ real.rotation
    fit = load(real)[1]
    by_hand = fit.mass * np.concatenate([pull, np.cross(fit.cog, pull)], axis=1)
    assert change(at_rest, fault) == pytest.approx(by_hand, abs=1e-9)
    found = at_rest.recorded([fault])
    read, was = (np.stack([r.columns[a] for a in ("ax", "ay", "az")], 1) for r in (found, real))
    assert np.abs(pull).max() > 0.02
    assert read - was == pytest.approx(-pull, abs=1e-12)


def test_a_heavier_tool_weighs_more_than_is_stated(at_rest):
    fault = drawn(at_rest, "tool.mass")
    weight, fit = load(static())
    assert change(at_rest, fault) == pytest.approx(weight * fault.true["mass"] / fit.mass, abs=1e-9)
    stated = at_rest.recorded([fault]).metadata.tool
    assert stated.mass == pytest.approx(fit.mass, abs=1e-4)


def test_a_late_clock_shifts_the_recorded_rows(moving):
    fault, real = drawn(moving, "timing.delay"), motion(1)
    late = CubicSpline(real.t, real.wrench)(np.maximum(real.t - fault.true["delay"], 0.0))
    assert change(moving, fault) == pytest.approx(late - real.wrench, abs=1e-9)


def test_ranges_and_counts_act_on_the_recorded_rows(at_rest, moving):
    fault = drawn(at_rest, "sensor.saturation", 4.0)
    limit, real = fault.rows.limit, static().wrench
    assert (np.abs(real) > limit).any()
    assert at_rest.with_faults([fault]) == pytest.approx(np.clip(real, -limit, limit))
    coarse = drawn(moving, "sensor.quantization", 4.0)
    step = np.where(coarse.rows.step > 0, coarse.rows.step, np.inf)
    counts = moving.with_faults([coarse]) / step
    assert (step < np.inf).any()
    assert counts == pytest.approx(np.round(counts), abs=1e-6)


def test_more_noise_is_a_multiple_of_the_rows_own_scatter(moving):
    fault = drawn(moving, "sensor.noise", 2.0)
    real, found = moving.setting, moving.with_faults([fault])
    ratio = (found - real.means(found)[real.path.hold]).std(axis=0) / real.scatter
    assert fault.rows.gain.max() > 1.5
    assert ratio == pytest.approx(fault.rows.gain, rel=0.06)


def test_the_gap_is_the_mean_square_in_the_recordings_noise(at_rest):
    fault = drawn(at_rest, "tool.mass", 4.0)
    cause = at_rest.measured(fault)
    assert cause.gap == pytest.approx(np.mean((change(at_rest, fault) / STD) ** 2))
    both = at_rest.causes("pair", np.random.default_rng(3))
    assert all(c.gap >= 1.5 for c in both)
    assert len({c.fault.name.split(".")[0] for c in both}) == 2


def test_effects_that_a_recording_cannot_show_are_not_drawn(at_rest, moving):
    rest, motion_ = set(at_rest.possible()), set(moving.possible())
    assert {"sensor.gain", "tool.mass", "base.tilt", "sensor.hysteresis"} <= rest & motion_
    assert {"timing.delay", "sensor.noise", "sensor.bias"} <= motion_ - rest
    assert not [n for n in rest | motion_ if n.startswith(("joint.", "cable.", "link."))]
    assert rest | motion_ < set(EFFECTS)


def test_nothing_is_made_of_a_recording_without_noise():
    bare = replace(static().metadata, sensor=SensorInfo("ati-gamma"))
    with pytest.raises(ParameterError, match="noise_std"):
        setting_of(Recording(bare, static().columns))


# ---- families ------------------------------------------------------------------------------------


@pytest.mark.slow
def test_cases_differ_in_what_a_fault_changes_only(semi_real):
    cases, answers, _ = semi_real
    told = {
        n: commitments.read_answer(commitments.answer_of(answers, n))
        for n in commitments.read(cases)
    }
    kinds = [a.kind for a in told.values()]
    assert (kinds.count("none"), len(kinds)) == (1, COUNT)
    assert {"single", "pair", "outside"} < set(kinds)
    real = static()
    assert len({a.real_gap for a in told.values()}) == 1
    for name, truth in told.items():
        found = Recording.read(commitments.recording_of(cases, name))
        assert found.metadata.tool.mass == pytest.approx(0.9337, abs=1e-4)
        assert found.metadata.source is None
        assert all((found.columns[c] == real.columns[c]).all() for c in ("t", "qw", "qx"))
        assert set(found.columns) == set(real.columns)
        assert (found.wrench == real.wrench).all() == (truth.kind == "none")
        assert all(c.gap >= 1.0 for c in truth.causes)


@pytest.mark.slow
def test_the_same_seed_makes_the_same_bytes(semi_real, tmp_path):
    cases, answers, host = semi_real
    for seed, same in ((SEED, True), (SEED + 1, False)):
        out, sealed = tmp_path / f"c{seed}", tmp_path / f"a{seed}"
        family = SemiRealFamily.on(host, COUNT, seed)
        make.open_family(family, out, sealed)
        make.make_case(family, out, sealed, 0)
        for folder, other, file in ((cases, out, "0001.parquet"), (answers, sealed, "0001.json")):
            assert ((folder / file).read_bytes() == (other / file).read_bytes()) == same


@pytest.mark.slow
def test_folders_lie_apart_and_belong_to_one_recording(semi_real, tmp_path):
    cases, answers, host = semi_real
    family = SemiRealFamily.on(host, COUNT, SEED)
    with pytest.raises(BenchmarkError, match="apart"):
        make.make(family, tmp_path, tmp_path / "inside", processes=1)
    real = static()
    columns = dict(real.columns) | {"fx": real.columns["fx"] + 0.1}
    Recording(real.metadata, columns).write(tmp_path / "another.parquet")
    another = SemiRealFamily.on(tmp_path / "another.parquet", COUNT, SEED)
    with pytest.raises(BenchmarkError, match="recording"):
        make.make(another, cases, answers, processes=1)
    assert "host.parquet" not in (answers / commitments.FAMILY).read_text()


def test_a_robot_with_joints_holds_faults_too(family):
    cases, _, _ = family
    host = HostRecording(setting_of(Recording.read(commitments.recording_of(cases, "0001"))))
    assert {"sensor.noise", "mount.rotation"} <= set(host.possible())
    assert host.real_gap < 30.0
    fault = drawn(host, "sensor.drift")
    rate = named(fault.true, "rate")
    span = change(host, fault)[-1] - change(host, fault)[0]
    assert span == pytest.approx(rate * host.setting.recording.t[-1], rel=0.02, abs=1e-9)
    assert true_numbers(fault, [(fault, 1.0)]) == fault.true


def test_what_is_claimed_of_the_recording_itself_is_no_misnaming(semi_real, tmp_path, capsys):
    cases, answers, _ = semi_real
    truthful(cases, answers, tmp_path / "claims" / "knows")

    def sure(always):
        def twist(truth, claim):
            if truth.kind == "none" and not always:
                return claim
            return Claim("identified", (("cable.pull",),), {"cable.pull": 1.0})

        return twist

    truthful(cases, answers, tmp_path / "claims" / "liar", sure(always=False))
    truthful(cases, answers, tmp_path / "claims" / "same", sure(always=True))
    line = ["blind", "score", str(cases), str(tmp_path / "claims"), str(answers), "--json"]
    assert main([*line, "--method", "knows"]) == 0
    told = json.loads(capsys.readouterr().out)
    values = {m: {k: told[m][k]["value"] for k in told[m]} for m in ("knows", "liar", "same")}
    assert values["knows"]["isolation"] == values["knows"]["pairs_found"] == 1.0
    assert values["knows"]["unknown"] == values["knows"]["unknown_partly"] == 1.0
    assert [values[m]["misnamed"] for m in values] == [0.0, 1.0, 0.0]
    assert [values[m]["isolation"] for m in ("liar", "same")] == [0.0, 0.0]
    assert told["knows"]["misnamed"]["n"] == COUNT - 1
    assert "oracle" not in told
    score = scoring.score(cases, tmp_path / "claims", answers, "knows")
    page = report.page(score).markdown()
    assert "calibrated gap of 8.50" in page
    assert "cases of a real recording" in page
