"""What several simulators predict for a recording (as configured, of fits, of twins), and how rows
are grouped and their rms is taken to show it."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wrenchbed import registry
from wrenchbed.data.recording import Recording
from wrenchbed.errors import ParameterError, printable
from wrenchbed.files.checked import load
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.simulation.closed_form import Model
from wrenchbed.twin.replay import simulate
from wrenchbed.twin.twin import Twin

MOST = 4
"""Most simulators in one picture."""


@dataclass(frozen=True, eq=False)
class Simulator:
    """Prediction of one simulator for all rows of a recording.

    Attributes:
        theta: the robot's parameters (P,).
        reading: predicted reading of every row (N, 6) [N, N·m].
        fitted: whether it comes from a fit.json.
    """

    name: str
    theta: np.ndarray
    reading: np.ndarray
    fitted: bool = False


def simulators(recording: Recording, files: Sequence[str | Path]) -> list[Simulator]:
    """Simulators of a recording: the configured one, then one for each fit.json or twin.json; a
    `ParameterError` if a file is no fit or twin, is of another robot, or there are too many."""
    if len(files) >= MOST:
        raise ParameterError(f"{len(files)} simulators: at most {MOST - 1} can be shown together")
    robot = robot_of(recording)
    model = Model.of(robot, recording.metadata)
    twins = [("configured", Twin(model, model.configured(recording.metadata)), False)]
    twins += [(printable(Path(file).stem), *_read(Path(file), model)) for file in files]
    return [
        Simulator(name, twin.robot_theta, simulate(twin, recording).wrench, fitted)
        for name, twin, fitted in twins
    ]


def modelled(recording: Recording) -> bool:
    """Whether the recording's robot has joints and a model, so that it can be simulated."""
    try:
        robot_of(recording)
    except ParameterError:
        return False
    return True


def robot_of(recording: Recording) -> SimulatedRobot:
    """The recording's robot; a `ParameterError` if it has no model that could be shown."""
    name = recording.metadata.robot
    robot = registry.load("robots", name) if registry.is_known("robots", name) else None
    if not isinstance(robot, SimulatedRobot) or not recording.joints:
        raise ParameterError(f"{recording.name}: there is no model of robot {name!r} to show")
    return robot


def noise_of(recording: Recording) -> np.ndarray:
    """Noise of one row (6,) [N, N·m]: as the metadata state, else the scatter of rows about their
    neighbours (also of a simulation without noise)."""
    stated = np.asarray(recording.metadata.sensor.noise_std or (0.0,) * 6, dtype=float)
    steps = np.abs(np.diff(recording.wrench, axis=0))
    middle = np.median(steps, axis=0) if len(steps) else np.zeros(6)
    return np.where(stated > 0.0, stated, np.maximum(middle / (np.sqrt(2.0) * 0.6745), 1e-9))


def order_of(recording: Recording) -> tuple[np.ndarray, str]:
    """Variable (N,) to order rows by, and its unit: ``pose`` at rest if known, else time, ``s``."""
    if recording.metadata.mode == "static" and "segment" in recording.columns:
        return recording.columns["segment"], "pose"
    return recording.t, "s"


def bins(order: np.ndarray, count: int) -> list[np.ndarray]:
    """Indices of rows, ordered by ``order`` (N,), in at most ``count`` groups of like size."""
    return [g for g in np.array_split(np.argsort(order, kind="stable"), count) if len(g)]


def binned_rms(residual: np.ndarray, groups: Sequence[np.ndarray]) -> np.ndarray:
    """Rms (C, B) of residuals (N, C) in each of B groups of row indices, NaN rows left out."""
    squares = np.ma.masked_invalid(residual**2)
    return np.sqrt(np.stack([squares[g].mean(axis=0).filled(np.nan) for g in groups], axis=1))


def _read(path: Path, model: Model) -> tuple[Twin, bool]:
    """Twin of a twin.json or fit.json (then without effects), and whether it was a fit.json."""
    raw = load(path, ParameterError)
    if not isinstance(raw, dict):
        raise ParameterError(f"{path}: is no fit or twin")
    if "parameters" not in raw:
        return Twin.read(path), False
    if raw.get("robot") != model.robot.name:
        raise ParameterError(f"{path}: is a fit of {raw.get('robot')!r}, not {model.robot.name!r}")
    try:
        theta = model.parameters.vector({k: float(v) for k, v in raw["theta"].items()})
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise ParameterError(f"{path}: theta: {error}") from error
    return Twin(model, theta), True
