"""Recordings for tests: MuJoCo's wrench, never the closed form that fits it."""

from collections.abc import Mapping

import numpy as np

from wrenchbed import registry
from wrenchbed.metadata import Metadata, SensorInfo, ToolInfo
from wrenchbed.model import Model
from wrenchbed.recording import Recording
from wrenchbed.simulation import Simulation
from wrenchbed.wrench import CHANNELS

WHITE = np.array([0.05, 0.05, 0.1, 2e-3, 2e-3, 2e-3])
"""Standard deviation of one row [N, N·m]."""


def static(
    robot: str,
    truth: Mapping[str, float],
    *,
    poses: int = 100,
    samples: int = 1,
    noise: np.ndarray | None = None,
    wander: float = 0.0,
    seed: int = 0,
) -> Recording:
    """Random poses at rest with independent normal noise, and a random offset of each hold."""
    arm = registry.load("robots", robot)
    rng = np.random.default_rng(seed)
    model = Model.of(arm)
    theta = model.parameters.vector(truth)
    own = theta[: len(arm.parameters)]
    q = arm.sample(poses, rng)
    assert not arm.infeasible(q, own)
    load = model.read(Simulation(arm, own).wrench(q), theta)
    return recording(robot, q, load, samples, noise, wander, rng)


def recording(robot, q, load, samples, noise, wander, rng) -> Recording:
    """Rows of poses q (N, J) with readings ``load`` (N, 6)."""
    n = len(q) * samples
    std = np.zeros(6) if noise is None else noise
    held = load + wander * std * rng.standard_normal(load.shape)
    y = np.repeat(held, samples, axis=0) + std * rng.standard_normal((n, 6))
    segment = np.repeat(np.arange(len(q)), samples)
    columns = {"t": np.arange(1, n + 1) / 100.0 + 2.0 * segment, "segment": segment}
    columns |= {f"q{j + 1}": np.repeat(q[:, j], samples) for j in range(q.shape[1])}
    columns |= {c: y[:, k] for k, c in enumerate(CHANNELS)}
    metadata = Metadata(
        robot, "static", "sim", 100.0, ToolInfo(), SensorInfo(noise_std=tuple(map(float, std)))
    )
    return Recording(metadata, columns)
