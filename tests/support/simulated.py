"""Recordings for tests: MuJoCo's wrench, never the closed form that fits it."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import wrenchbed as wb
from wrenchbed.data.metadata import Metadata, SensorInfo, ToolInfo
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.medrue.kinematics import PAPER

WHITE = np.array([0.05, 0.05, 0.1, 2e-3, 2e-3, 2e-3])
"""Standard deviation of one row [N, N·m]."""
_GOLDEN = json.loads((Path(__file__).parents[1] / "data" / "medrue_golden.json").read_text())
_UNIT = np.array([{"m": 1e-3, "rad": np.pi / 180, "kg": 1.0}[p.unit] for p in PAPER])
MEDRUE_TRUTH = dict(zip(PAPER.names, np.array(_GOLDEN["actual"]) * _UNIT, strict=True))
UR5_TRUTH = {
    "tool.mass": 1.42, "tool.cog.x": 0.007, "tool.cog.y": -0.002, "tool.cog.z": 0.083,
    "mount.rotation.x": 0.01, "mount.rotation.y": -0.015, "mount.rotation.z": 0.02,
    "sensor.bias.fx": 3.0, "sensor.bias.fy": -8.0, "sensor.bias.fz": 12.0,
    "sensor.bias.tx": 0.1, "sensor.bias.ty": -0.2, "sensor.bias.tz": 0.05,
}  # fmt: skip


def static(
    robot: str,
    truth: Mapping[str, float],
    *,
    poses: int = 100,
    samples: int = 1,
    noise: np.ndarray | None = None,
    wander: float = 0.0,
    seed: int = 0,
) -> wb.Recording:
    """Random poses at rest with independent normal noise, and a random offset of each hold."""
    arm = wb.load("robots", robot)
    rng = np.random.default_rng(seed)
    model = wb.Model.of(arm)
    theta = model.parameters.vector(truth)
    own = theta[: len(arm.parameters)]
    q = arm.sample(poses, rng)
    assert not arm.infeasible(q, own)
    load = model.read(wb.Simulation(arm, own).wrench(q), theta)
    return recording(robot, q, load, samples, noise, wander, rng)


def driven(plan: wb.Plan, path: Path, samples: int = 20, **options: Any) -> wb.Recording:
    """What the simulator's driver, with its options, records of a plan."""
    with wb.SimDriver(wb.SimOptions(plan.robot, **options)) as driver:
        wb.record(driver, plan, path, samples=samples)
    return wb.Recording.read(path)


def as_driven(rec: wb.Recording) -> wb.Recording:
    """The recording with all that the simulator's driver states, its noise included."""
    with wb.SimDriver(wb.SimOptions(rec.metadata.robot)) as driver:
        return replace(rec, metadata=driver.metadata("static", rec.metadata.rate_hz))


def with_tool(rec: wb.Recording, mass: float, *cog: float) -> wb.Recording:
    """The recording with a tool [kg, m] as its metadata state it."""
    return replace(rec, metadata=replace(rec.metadata, tool=ToolInfo(float(mass), tuple(cog))))


def recording(robot, q, load, samples, noise, wander, rng) -> wb.Recording:
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
    return wb.Recording(metadata, columns)
