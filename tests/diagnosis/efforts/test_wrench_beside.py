"""Joint torques and wrench together: a payload is seen by both, friction by one only."""

from dataclasses import replace

import numpy as np
import pytest
from arm_gaps import Gap, case
from arm_torques import COG, MASS, UR5, fourier

from wrenchbed.benchmark.efforts.arm import Path, TrueArm
from wrenchbed.cli import main
from wrenchbed.diagnosis.efforts.diagnose_efforts import diagnose_efforts
from wrenchbed.errors import DiagnosisError
from wrenchbed.physics.wrench import CHANNELS

HEALTHY = Gap()
SEED, SECONDS = 24, 30.0
NOISE = np.array([0.2, 0.2, 0.3, 0.02, 0.02, 0.01])  # [N, N·m]


def both(gap=HEALTHY, more=0.0):
    """A case with the wrench of the same motion by differentiated poses of MuJoCo's sensor."""
    made = case(gap, SEED, SECONDS, configured=True)
    t, q = fourier(np.random.default_rng(SEED), SECONDS)
    path = Path("fourier", 1.0 / (t[1] - t[0]), t, q.v, q.d, q.dd)
    theta = UR5.theta_of_tool(UR5.parameters.nominal.copy(), MASS + more, COG)
    load = TrueArm(UR5, theta).wrench(path)
    load = load + NOISE * np.random.default_rng(9).normal(size=load.shape) + [3, -2, 5, 0, 0.1, 0]
    columns = dict(made.columns) | {c: load[:, k] for k, c in enumerate(CHANNELS)}
    return replace(made, columns=columns)


def answers(found):
    return [(w["effect"], w["rivals"]) for w in found.diagnosis.which]


@pytest.mark.slow
def test_a_payload_that_torques_alone_do_not_tell_is_named_and_weighed():
    light = 0.12  # [kg]
    recording = both(Gap("tool.mass", size=light), more=light)
    alone = diagnose_efforts(recording)
    assert not alone.diagnosis.which or alone.diagnosis.which[0]["probability"] < 0.9
    found = diagnose_efforts(recording, wrench=True)
    assert answers(found) == [("tool.mass", [])]
    (only,) = found.diagnosis.which
    assert only["probability"] > 0.9
    mass = only["parameters"]["mass"]
    assert mass["value"] == pytest.approx(light, abs=max(0.005, 3.0 * mass["std"]))
    channels = found.diagnosis.gap.per_channel
    assert list(channels)[6:] == list(CHANNELS)
    worst = max(CHANNELS, key=lambda c: channels[c]["before"])
    assert channels[worst]["before"] > 0.8 and abs(channels[worst]["after"]) < 0.1


@pytest.mark.slow
def test_friction_is_seen_by_its_joint_alone_and_the_sensor_agrees():
    found = diagnose_efforts(both(Gap("drive.coulomb", 3, 6.0)), wrench=True)
    assert answers(found) == [("drive.coulomb", [])]
    assert found.diagnosis.which[0]["parameters"]["joint"]["value"] == 3
    assert max(found.diagnosis.gap.per_channel[c]["before"] for c in CHANNELS) < 0.2
    assert np.array([n.std for n in found.d.noise[6:]]) == pytest.approx(NOISE, rel=0.1)


@pytest.mark.slow
def test_what_only_the_sensor_has_is_unknown_and_its_channel_is_said():
    recording = both()
    columns = dict(recording.columns)
    columns["fy"] = columns["fy"] + 2.0 * np.sin(np.linspace(0.0, 5.0, len(columns["fy"])))
    found = diagnose_efforts(replace(recording, columns=columns), wrench=True).diagnosis
    assert found.verdict == "unknown" and not found.which
    assert (found.where[0]["subsystem"], found.where[0]["detail"]) == ("sensor", "fy")


def test_a_recording_without_a_wrench_says_what_to_do(tmp_path, capsys):
    recording = case(seed=SEED, seconds=SECONDS)
    with pytest.raises(DiagnosisError, match="--channels effort"):
        diagnose_efforts(recording, wrench=True)
    recording.write(tmp_path / "rec.parquet")
    asked = ["diagnose", str(tmp_path / "rec.parquet"), "--channels", "both"]
    assert main([*asked, "--out", str(tmp_path / "found")]) == 1
    assert "has no wrench" in capsys.readouterr().err
