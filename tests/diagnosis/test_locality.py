"""A residual that lies in a narrow range of one joint is found there, and only there."""

from types import SimpleNamespace

import numpy as np
import pytest

from wrenchbed.diagnosis.gap.locality import locality

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


def test_what_is_large_at_one_time_has_no_joint():
    prepared, rng = motion(3)
    residual = rng.normal(size=(ROWS, 6))
    residual[300:330] *= 40.0
    found = locality(prepared, residual, NOISE, 199, 0)
    assert found is None or found.p_value > 0.05


def test_noise_has_no_joint():
    prepared, rng = motion(4)
    found = locality(prepared, rng.normal(size=(ROWS, 6)), NOISE, 199, 0)
    assert found is None or found.p_value > 0.05
