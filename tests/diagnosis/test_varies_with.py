"""Where a residual lies: nothing in noise, the right variable or range of a joint elsewhere."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import kstest

from altered import at_point
from simulated import WHITE, static
from wrenchbed import registry
from wrenchbed.benchmark.lookalikes import ExperimentDesign, draw, recording
from wrenchbed.diagnosis.diagnose import diagnose
from wrenchbed.diagnosis.gap.dependence import Partitions, family_wise
from wrenchbed.diagnosis.gap.varies_with import Finding, entries, locality, locate
from wrenchbed.diagnosis.prepare.prepare_recording import prepare
from wrenchbed.effects.chain import respond
from wrenchbed.planning.choose import multisine, poses


def design_of(mode):
    robot = registry.load("robots", "ur5")
    if mode == "motion":
        return ExperimentDesign.of_plan(multisine(robot, 16.0, 125.0, 1), robot)
    return ExperimentDesign.of_plan(poses(robot, 60, 3), robot)


@cache
def bench(mode):
    """A sound recording and the residuals that its fit takes away."""
    design = design_of(mode)
    prepared = prepare(recording(design, draw(design, 1, "none")))
    return prepared, Partitions(prepared).fitted


def fitted_away(rows, basis):
    return (rows.ravel() - basis @ (basis.T @ rows.ravel())).reshape(rows.shape)


def noise(prepared, rng, kind):
    """Unit noise of raw rows (H, 6), or of the means over a pose, in readings."""
    size = (len(prepared.y), 6)
    unit = rng.standard_normal(size)
    if kind == "heavy":
        unit = rng.standard_t(5, size) * np.sqrt(3 / 5)
    if kind == "memory":
        unit = lfilter([0.8], [1.0, -0.6], rng.standard_normal((size[0] + 100, 6)), axis=0)[100:]
    size = 1.0 if prepared.moving else np.sqrt(prepared.noise)
    return unit * size @ np.diag(prepared.sigma)


def made(mode, seed, signal=None, gap=1.0, kind="normal"):
    """A recording whose readings are the model's, noise, and a signal (H, 6) of a gap."""
    prepared, basis = bench(mode)
    base = respond(prepared.scene)[prepared.scene.held]
    reading = base + noise(prepared, np.random.default_rng([seed, 5]), kind)
    if signal is not None:
        shown = fitted_away(prepared.rows(signal), basis)
        reading = reading + signal * np.sqrt(gap / np.mean(shown**2))
    case = replace(prepared, y=reading)
    return case, fitted_away(case.rows(reading - base), basis)


def load(prepared, down):
    """A change of gravity's direction in the sensor (H, 3) as a change of readings (H, 6)."""
    tool = prepared.scene.tool
    force = 9.80665 * float(tool.mass) * down
    return at_point(force, np.asarray(tool.cog, dtype=float))


def turned(prepared, joint):
    """Change of gravity's direction in the sensor with a joint (H, 3) [1/rad]."""
    scene = prepared.scene
    q = scene.joints[scene.held]
    step = 1e-5 * np.eye(q.shape[1])[joint]
    up, down = (scene.robot.sensor_pose(q + s * step, scene.theta)[0] for s in (1, -1))
    return np.asarray([0.0, 0.0, -1.0]) @ (up - down) / 2e-5


def signals(prepared):
    """Residuals of which one knows where they lie (H, 6)."""
    scene, held = prepared.scene, prepared.scene.held
    rotation, age = scene.pose[0][held], scene.age[held, None] / scene.span
    reading = respond(scene)
    rising = np.sign(np.diff(reading, axis=0, prepend=reading[:1]))[held]
    return {
        "orientation": load(prepared, np.swapaxes(rotation, 1, 2) @ [0.3, 0.8, 0.0]),
        "joint 2": load(prepared, scene.joint_torque[held][:, 1:2] * turned(prepared, 1)),
        "time": age * np.eye(6)[3],
        "direction of joint 2": load(prepared, scene.coming[held][:, 1:2] * turned(prepared, 1)),
        "direction of load": rising * prepared.sigma,
    }


@pytest.mark.sampled
@pytest.mark.parametrize("kind", ["memory", "normal", "heavy"])
def test_noise_with_memory_is_no_finding_in_motion(kind):
    alarms = sum(
        any(f.seen for f in locate(*made("motion", seed, kind=kind), 99, seed)) for seed in range(6)
    )
    assert alarms <= 2


def test_p_values_of_noise_are_even():
    prepared, _ = bench("poses")
    parts = Partitions(prepared)
    alone = []
    for seed in range(60):
        case, residual = made("poses", 1000 + seed, kind=("normal", "heavy")[seed % 2])
        alone.append(family_wise(parts, residual, case.block_rows, 99, seed)[1])
    for p_value in np.transpose(alone):
        assert kstest(p_value, "uniform").pvalue > 1e-4
        assert (p_value < 0.05).mean() < 0.17


@pytest.mark.parametrize(
    "variable", ["orientation", "joint 2", "time", "direction of joint 2", "direction of load"]
)
def test_a_gap_of_one_is_found_where_it_lies(variable):
    signal = signals(bench("poses")[0])[variable]
    for seed in range(3):
        first = locate(*made("poses", seed, signal), seed=seed)[0]
        assert first.variable == variable and first.p_value < 0.01 and first.share > 0.7
        assert "%" in first.sentence


def test_a_drift_in_motion_is_found_in_time_and_a_delay_in_speed():
    prepared, _ = bench("motion")
    age = prepared.scene.age[:, None] / prepared.scene.span
    for seed in range(3):
        first = locate(*made("motion", seed, age * np.eye(6)[3]))[0]
        assert first.variable == "time" and first.p_value < 0.01
    rate = np.gradient(respond(prepared.scene), prepared.scene.period, axis=0)
    first = locate(*made("motion", 0, rate))[0]
    assert first.variable == "speed" and first.p_value < 0.01 and first.share > 0.8


def test_a_residual_without_noise_or_gap_breaks_nothing():
    case, residual = made("poses", 0)
    assert locate(case, residual, 49, 1) == locate(case, residual, 49, 1)
    assert not any(f.seen for f in locate(case, np.zeros_like(residual), 19))


@pytest.mark.parametrize(
    ("variable", "subsystem"),
    [
        ("load", "sensor"), ("direction of joint 3", "joint"), ("position", "cable"),
        ("speed", "timing"),
    ],
)  # fmt: skip
def test_without_a_cause_what_is_seen_is_a_hint(variable, subsystem):
    findings = [Finding(variable, 0.6, 0.005, "Seen."), Finding("joint 1", 0.0, 0.3, "Not seen.")]
    (entry,) = entries([], findings)
    assert entry["subsystem"] == subsystem and entry["detail"] == variable
    assert "only a hint" in entry["sentence"] and entry["sentence"].startswith("Seen.")


def test_hints_are_one_a_subsystem_and_causes_entries_in_their_order():
    each = zip(("time", "speed", "load"), (0.6, 0.3, 0.0), (5e-3, 5e-3, 5e-3), strict=True)
    findings = [Finding(*f, "It is seen.") for f in each]
    assert [e["detail"] for e in entries([], findings)] == ["time", "speed"]
    assert [e["detail"] for e in entries([], findings[2:])] == ["load"]
    assert entries([], [Finding("time", 0.0, 0.5, "Not seen.")]) == []
    both = [Finding(v, 0.2, 1e-9, f"{v} is seen.") for v in ("time", "load")]
    assert ["only a hint" in e["sentence"] for e in entries([], both)] == [True, False]
    causes = [("joint.compliance", "joint 2|3|4", 0.7, 0.0),
              ("base.tilt", "", 0.2, 1e-4, ("cable.pull",), "configured")]  # fmt: skip
    first, second = entries(causes, [Finding("time", 0.9, 0.005, "…")])
    assert (first["subsystem"], first["detail"], first["share"]) == ("joint", "joint 2|3|4", 0.7)
    assert 0.0 < first["p_value"] < 1e-100 and "joint 2|3|4" in first["sentence"]
    said = "20 % of the configured gap lies in the base or the cable: base.tilt or cable.pull."
    assert (second["subsystem"], second["sentence"]) == ("base", said)


ROWS, JOINTS = 600, 4
NOISE = np.ones(6)


def motion(seed):
    """Averaged rows of a motion in which each joint goes its own way, in blocks of 25 rows."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 1.0, ROWS)
    waves = rng.uniform(2.0, 7.0, (JOINTS, 3)), rng.uniform(0, 2 * np.pi, (JOINTS, 3))
    q = np.sin(2 * np.pi * waves[0][:, :, None] * t + waves[1][:, :, None]).sum(axis=1).T
    return SimpleNamespace(
        scene=SimpleNamespace(jointed=True), poses=q, averages=lambda x: x,
        block_rows=np.arange(ROWS) // 25,
    ), rng  # fmt: skip


@pytest.mark.parametrize("seed", range(10))
def test_a_spike_is_found_at_its_joint_and_angle(seed):
    prepared, rng = motion(seed)
    joint = int(rng.integers(JOINTS))
    at = float(np.quantile(prepared.poses[:, joint], rng.uniform(0.3, 0.7)))
    spike = 40.0 * np.exp(-0.5 * ((prepared.poses[:, joint] - at) / 0.05) ** 2)
    residual = rng.normal(size=(ROWS, 6)) + spike[:, None] * rng.normal(size=6)
    found = locality(prepared, residual, NOISE, 199, seed)
    assert found.joint == joint + 1 and found.p_value < 0.02
    assert found.low - 0.1 < at < found.high + 0.1
    assert found.share > 0.5 > 5 * found.rows


@pytest.mark.parametrize("seed", range(4))
def test_a_spike_that_a_few_of_60_poses_show_is_found_too(seed):
    prepared, rng = motion(seed)
    q = rng.uniform(-2.0, 2.0, (60, JOINTS))
    q[rng.permutation(60)[:7], 2] = rng.uniform(-0.03, 0.03, 7)
    near = np.abs(q[:, 2]) < 0.04
    residual = rng.normal(size=(60, 6)) + 30.0 * near[:, None]
    prepared.poses, prepared.block_rows = q, np.arange(60)
    found = locality(prepared, residual, NOISE, 199, seed)
    assert (found.joint, found.p_value < 0.02) == (3, True) and -0.04 < found.low < found.high


def test_what_is_large_at_one_time_or_noise_has_no_joint():
    for seed, factor in ((3, 40.0), (4, 1.0)):
        prepared, rng = motion(seed)
        residual = rng.normal(size=(ROWS, 6))
        residual[300:330] *= factor
        found = locality(prepared, residual, NOISE, 199, 0)
        assert found is None or found.p_value > 0.05


def test_a_gap_that_varies_with_nothing_lies_in_its_channel():
    rec = static("ur5", {}, poses=40, samples=20, noise=WHITE, seed=4)
    pose = np.repeat(np.arange(40), 20)
    off = np.random.default_rng(0).normal(size=40)[pose]
    changed = replace(rec, columns=dict(rec.columns) | {"fz": rec.columns["fz"] + off})
    d = diagnose(changed).diagnosis
    assert d.verdict == "unknown"
    assert d.where[0]["detail"] == "fz" and d.where[0]["share"] > 0.9
