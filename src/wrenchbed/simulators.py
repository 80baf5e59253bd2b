"""Simulators to hold against a recording: as configured, a fit's, a twin's."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.errors import ParameterError, WrenchbedError
from wrenchbed.model import Model
from wrenchbed.playback import simulate
from wrenchbed.recording import Recording
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.twin import Twin

MOST = 4
"""Simulators that one picture can show apart."""


@dataclass(frozen=True, eq=False)
class Simulator:
    """A name for people, the robot's parameters (P,), and readings (N, 6) [N, N·m]."""

    name: str
    theta: np.ndarray
    reading: np.ndarray


def simulators(recording: Recording, files: Sequence[str | Path]) -> list[Simulator]:
    """As the recording configures it, then of each file: a fit, or a twin.

    Raises:
        ParameterError: a file is neither, of another robot, or there are too many.
    """
    if len(files) >= MOST:
        raise ParameterError(f"{len(files)} simulators: at most {MOST - 1} can be told apart")
    robot = robot_of(recording)
    model = Model.of(robot, recording.metadata)
    found = [_of("configured", Twin(model, model.configured(recording.metadata)), recording)]
    for file in files:
        path = Path(file)
        found.append(_of(path.stem, _read(path, model), recording))
    return found


def modelled(recording: Recording) -> bool:
    """Whether the recording's robot has joints and a model."""
    name = recording.metadata.robot
    known = name in registry.names("robots") and registry.load("robots", name)
    return isinstance(known, SimulatedRobot) and bool(recording.joints)


def robot_of(recording: Recording) -> SimulatedRobot:
    """The recording's robot.

    Raises:
        ParameterError: it has no model that could be shown.
    """
    robot = registry.load("robots", recording.metadata.robot)
    if not isinstance(robot, SimulatedRobot) or not recording.joints:
        raise ParameterError(
            f"{recording.name}: robot {recording.metadata.robot!r} has no joints to show"
        )
    return robot


def noise_of(recording: Recording) -> np.ndarray:
    """Noise of a row (6,) [N, N·m]: as stated, else how rows scatter about their neighbours."""
    stated = recording.metadata.sensor.noise_std
    if stated is not None:
        return np.asarray(stated, dtype=float)
    steps = np.abs(np.diff(recording.wrench, axis=0))
    return np.maximum(np.median(steps, axis=0) / (np.sqrt(2.0) * 0.6745), 1e-9)


def _of(name: str, twin: Twin, recording: Recording) -> Simulator:
    return Simulator(name, twin.own, simulate(twin, recording).wrench)


def _read(path: Path, model: Model) -> Twin:
    """A twin.json, or a fit.json as a twin without effects."""
    raw = _json(path)
    if "parameters" not in raw:
        return Twin.read(path)
    if raw.get("robot") != model.robot.name:
        raise ParameterError(f"{path}: is a fit of {raw.get('robot')!r}, not {model.robot.name!r}")
    try:
        theta = model.parameters.vector({k: float(v) for k, v in raw["theta"].items()})
    except (KeyError, TypeError, ValueError, AttributeError, WrenchbedError) as error:
        raise ParameterError(f"{path}: theta: {error}") from error
    return Twin(model, theta)


def _json(path: Path) -> dict[str, Any]:
    try:
        raw = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ParameterError(f"{path}: no fit or twin can be read from it: {error}") from error
    if not isinstance(raw, dict):
        raise ParameterError(f"{path}: is no fit or twin")
    return raw
