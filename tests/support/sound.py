"""Sound recordings with the values that a fit of them must find, and ways to record them."""

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import wrenchbed as wb
from altered import (
    QUATERNION,
    at_point,
    by_name,
    holds,
    with_added,
    with_metadata,
    with_wrench,
    without_noise_stated,
)
from arm_files import CASES, TOOL_COG, TOOL_MASS
from simulated import MEDRUE_TRUTH, UR5_TRUTH, WHITE, driven, static
from wrenchbed.data.metadata import Metadata, SensorInfo, ToolInfo
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.medrue.kinematics import PAPER

Random = np.random.Generator
GRAVITY = np.array([0.0, 0.0, -9.80665])
TOOL = ("tool.mass", "tool.cog.x", "tool.cog.y", "tool.cog.z")
BASES = ("ur5", "medrue", "oriented", "motion", "file")
"""Two robots at rest, orientations only at rest, a UR5 in motion, an arm of a user's file."""


@dataclass(frozen=True, eq=False)
class Good:
    """A recording with the values that a fit of it must find, by name."""

    recording: wb.Recording
    truth: Mapping[str, float]


def good(base: str, seed: int) -> Good:
    """A sound recording of one of `BASES`, its tool stated."""
    rng = np.random.default_rng([seed, 41])
    if base == "motion":
        r, bias = moved(seed % 8, 12.0, 100.0), _bias(rng)
        truth = dict(zip(TOOL, (r.metadata.tool.mass, *r.metadata.tool.cog), strict=True))
        return Good(with_added(r, np.tile(list(bias.values()), (len(r), 1))), truth | bias)
    if base == "medrue":
        poses, rows = int(rng.integers(40, 90)), int(rng.integers(4, 20))
        robot = wb.load("robots", "medrue")
        values = {k: v for k, v in MEDRUE_TRUTH.items() if k in PAPER.names}
        tool = robot.tool(robot.parameters.vector(values))
        r = static("medrue", MEDRUE_TRUTH, poses=poses, samples=rows, noise=WHITE, seed=seed)
        return Good(_stated(r, float(tool.mass), tool.cog), MEDRUE_TRUTH)  # its sensor is tared
    truth = _tool(rng) | _bias(rng)
    if base in ("ur5", "file"):
        truth |= {k: v for k, v in UR5_TRUTH.items() if k.startswith("mount")}
    mass, *cog = (truth[n] for n in TOOL)
    poses, rows = int(rng.integers(24, 70)), int(rng.integers(4, 20))
    if base in ("ur5", "file"):
        robot = base if base == "ur5" else arm_of_file()
        r = static(robot, truth, poses=poses, samples=rows, noise=WHITE, seed=seed)
        return Good(_stated(r, mass, cog), truth)
    return Good(_stated(_oriented(rng, truth, poses, rows), mass, cog), truth)


@cache
def arm_of_file() -> str:
    """Name of an arm with seven joints, described from a user's MJCF."""
    case = next(c for c in CASES if c.file == "iiwa.xml")
    settings = Path(tempfile.mkdtemp()) / "arm.toml"
    wb.describe_robot(case.path, case.frame, settings, tool_mass=TOOL_MASS, tool_cog=TOOL_COG)
    return str(settings)


@cache
def moved(seed: int, seconds: float, rate: float) -> wb.Recording:
    """A multisine of a UR5."""
    plan = wb.multisine(wb.load("robots", "ur5"), seconds, rate, seed=seed)
    with tempfile.TemporaryDirectory() as folder:
        return driven(plan, Path(folder) / "rec.parquet", noise="white", seed=seed)


def _tool(rng: Random) -> dict[str, float]:
    cog = rng.uniform([-0.02, -0.02, 0.03], [0.02, 0.02, 0.12])
    return dict(zip(TOOL, (float(rng.uniform(0.6, 3.0)), *map(float, cog)), strict=True))


def _bias(rng: Random) -> dict[str, float]:
    values = rng.normal(0.0, [5.0, 5.0, 10.0, 0.2, 0.2, 0.2])
    return {f"sensor.bias.{c}": float(v) for c, v in zip(CHANNELS, values, strict=True)}


def _stated(r: wb.Recording, mass: float, cog: np.ndarray | list[float]) -> wb.Recording:
    return with_metadata(r, tool=ToolInfo(mass, tuple(map(float, cog))))


def _oriented(rng: Random, truth: Mapping[str, float], poses: int, rows: int) -> wb.Recording:
    turn = Rotation.random(poses, random_state=int(rng.integers(2**31)))
    segment = np.repeat(np.arange(poses), rows)
    mass, *cog = (truth[n] for n in TOOL)
    y = at_point(turn[segment].inv().apply(mass * GRAVITY), cog)
    y += [truth[f"sensor.bias.{c}"] for c in CHANNELS]
    y += WHITE * rng.standard_normal((len(segment), 6))
    columns = {"t": np.arange(1, len(segment) + 1) / 100.0 + 2.0 * segment, "segment": segment}
    columns |= by_name(QUATERNION, turn[segment].as_quat(scalar_first=True))
    sensor = SensorInfo(noise_std=tuple(map(float, WHITE)))
    metadata = Metadata("oriented", "static", "import", 100.0, ToolInfo(), sensor)
    return wb.Recording(metadata, columns | by_name(CHANNELS, y))


Variation = Callable[[wb.Recording, Random], wb.Recording]


def _averaged(r: wb.Recording, rng: Random) -> wb.Recording:
    """One row a hold, its noise stated as that of such a row; a motion stays as it is."""
    if r.metadata.mode == "dynamic":
        return r
    hold, std = holds(r), r.metadata.sensor.noise_std
    count = np.bincount(hold)
    columns = {k: np.bincount(hold, v) / count for k, v in r.columns.items() if k != "segment"}
    alone = tuple(float(s / np.sqrt(count.mean())) for s in std)
    one = wb.Recording(r.metadata, columns, r.name)
    return with_metadata(one, sensor=replace(r.metadata.sensor, noise_std=alone))


def _more_noise(draw: Callable[[wb.Recording, Random], np.ndarray]) -> Variation:
    """So many row's deviations (N, 6) more."""
    return lambda r, rng: with_added(r, draw(r, rng) * WHITE)


def _wander_of_holds(r: wb.Recording, rng: Random) -> np.ndarray:
    hold = holds(r)
    return 2.0 * rng.standard_normal((hold.max() + 1, 6))[hold]


def _slow_walk(r: wb.Recording, rng: Random) -> np.ndarray:
    walk = 4.0 * np.cumsum(rng.standard_normal((len(r), 6)), axis=0) / np.sqrt(len(r))
    return np.asarray(walk - walk.mean(axis=0))


def _kept_noise(r: wb.Recording, rng: Random) -> np.ndarray:
    """Noise of first order that forgets within five rows."""
    white, result = rng.standard_normal((len(r), 6)), np.zeros((len(r), 6))
    for k in range(1, len(r)):
        result[k] = 0.8 * result[k - 1] + 0.6 * white[k]
    return result


def _coarse(r: wb.Recording, rng: Random) -> wb.Recording:
    step = 4.0 * WHITE
    return with_wrench(r, np.round(r.wrench / step) * step)


def _stating(times: float, r: wb.Recording, rng: Random) -> wb.Recording:
    """A stated noise so many times the true one."""
    std = tuple(times * s for s in r.metadata.sensor.noise_std)
    return with_metadata(r, sensor=replace(r.metadata.sensor, noise_std=std))


SOUND: dict[str, Variation] = {
    "as it is": lambda r, rng: r,
    "noise not stated": lambda r, rng: without_noise_stated(r),
    "half the noise stated": partial(_stating, 0.5),
    "twice the noise stated": partial(_stating, 2.0),
    "averaged": _averaged,
    "averaged, noise not stated": lambda r, rng: without_noise_stated(_averaged(r, rng)),
    "holds wander": _more_noise(_wander_of_holds),
    "slow walk": _more_noise(_slow_walk),
    "noise of first order": _more_noise(_kept_noise),
    "heavy tails": _more_noise(lambda r, rng: 0.7 * rng.standard_t(4.0, (len(r), 6))),
    "coarse": _coarse,
}
"""Ways to record that make a fit less sure, never wrong."""
