"""A plan as if it had been recorded: a nominal robot, its sensor's noise, nothing else.

What a plan could show before it is recorded.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from wrenchbed import registry
from wrenchbed.data.metadata import Metadata, SensorInfo, ToolInfo
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import QUATERNION, Recording
from wrenchbed.diagnosis.evidence.dictionary import build
from wrenchbed.diagnosis.evidence.search import Searcher
from wrenchbed.diagnosis.evidence.similarity import Similarity
from wrenchbed.diagnosis.next.blind import BlindSpot, Design, Showing, blind_spots, showings
from wrenchbed.diagnosis.next.isolability import cannot_tell
from wrenchbed.diagnosis.prepare import scenes
from wrenchbed.diagnosis.prepare.baseline import tolerances
from wrenchbed.diagnosis.prepare.configuration import Configuration
from wrenchbed.diagnosis.prepare.prepare_recording import prepare
from wrenchbed.diagnosis.prepare.prepared import Prepared
from wrenchbed.effects.chain import respond
from wrenchbed.errors import DiagnosisError
from wrenchbed.jobs.workers import one_thread
from wrenchbed.physics.noise import NoiseStream
from wrenchbed.physics.time_derivatives import Jet
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.base import INERTIA_AXES, Robot
from wrenchbed.robots.motion_limits import duration
from wrenchbed.simulation.closed_form import Model

SAMPLES, RATE = 60, 100.0
"""Rows at a pose and their rate [Hz]."""
RUNG = 1
"""Background of ordinary imperfections that is assumed: the middle one of the normal ones."""


def of_plan(
    plan: Plan,
    metadata: Metadata | None = None,
    samples: int = SAMPLES,
    rate: float = RATE,
    seed: int = 0,
) -> Prepared:
    """Prepare what a plan would record from a nominal robot.

    Args:
        metadata: what the recording will state; by default the robot's own numbers.
        samples: rows a pose, where the plan gives no dwell.
        rate: of sampling [Hz], where the plan gives none.

    Raises:
        DiagnosisError: such a recording could not be diagnosed, and why.
        NotFoundError: there is no such robot.
    """
    return prepare(recording_of(plan, metadata, samples, rate, seed), seed)


def recording_of(
    plan: Plan,
    metadata: Metadata | None = None,
    samples: int = SAMPLES,
    rate: float = RATE,
    seed: int = 0,
) -> Recording:
    """The recording itself, in closed form.

    Raises:
        DiagnosisError: a plan of touches.
    """
    if plan.points is not None:
        raise DiagnosisError(f"{plan.name}: a plan of touches records no free load to diagnose")
    robot: Robot = registry.load("robots", plan.robot)
    moving = plan.mode == "dynamic"
    rate = float(plan.rate_hz or rate)
    meta = nominal_metadata(robot, plan.mode, rate) if metadata is None else metadata
    meta = replace(meta, mode=plan.mode, rate_hz=rate)
    model = Model.of(robot, meta)
    robot_theta = Configuration(model, model.configured(meta)).robot_theta
    if moving:
        t = np.arange(len(plan)) / rate
        count = np.ones(len(plan), dtype=int)
        d = np.gradient(plan.q, 1.0 / rate, axis=0)
        jet = Jet(plan.q, d, np.gradient(d, 1.0 / rate, axis=0))
        clean = respond(scenes.of_motion(model, robot_theta, jet, t, None))
    else:
        count = rows_of(plan, samples, rate)
        start = begins(robot, plan.q, count / rate)
        scene = scenes.of_poses(model, robot_theta, plan.q, start + count / (2 * rate), None)
        clean = np.repeat(respond(scene)[scene.held], count, axis=0)
        within = np.arange(len(clean)) - np.repeat(np.cumsum(count) - count, count)
        t = np.repeat(start, count) + within / rate
    sensor = registry.load("sensors", robot.sensor)
    rows, _ = NoiseStream(sensor.noise, seed).corrupt(t, clean)
    names = [f"q{j + 1}" for j in range(len(robot.joints))] or list(QUATERNION)
    columns = {"t": t} | {n: np.repeat(plan.q[:, j], count) for j, n in enumerate(names)}
    columns |= {c: np.asarray(rows)[:, k] for k, c in enumerate(CHANNELS)}
    columns["segment"] = np.repeat(plan.segment, count)
    return Recording(meta, columns, plan.name)


def rows_of(plan: Plan, samples: int, rate: float) -> np.ndarray:
    """Number of rows at each pose (N,) as a campaign records them."""
    rows = np.where(plan.dwell > 0, np.round(plan.dwell * rate), samples)
    return np.asarray(np.maximum(rows, 1), dtype=int)


def begins(robot: Robot, q: np.ndarray, stay: np.ndarray) -> np.ndarray:
    """Times (N,) [s] at which poses (N, J) are reached, staying for ``stay`` (N,) [s] at each."""
    if robot.joints:
        moves = [duration(robot, a, b) for a, b in pairwise(q)]
    else:
        moves = [3.0] * (len(q) - 1)
    steps = np.asarray(moves) + stay[:-1]
    return np.concatenate([[0.0], np.cumsum(steps)])


def nominal_metadata(robot: Robot, mode: str, rate: float) -> Metadata:
    """Metadata of a recording of the nominal robot."""
    nominal = robot.parameters.nominal
    tool, values = robot.tool(nominal), robot.values(nominal)
    sensor = registry.load("sensors", robot.sensor)
    return Metadata(
        robot=robot.name,
        mode=mode,
        source="plan",
        rate_hz=rate,
        tool=ToolInfo(
            float(tool.mass),
            tuple(float(c) for c in tool.cog),
            tuple(float(values[f"tool.inertia.{a}"]) for a in INERTIA_AXES),
        ),
        sensor=SensorInfo(
            sensor.name,
            tuple(float(s) for s in sensor.noise.row_std),
            float(values["sensor.mass"]),
        ),
        gravity=robot.gravity,
    )


@dataclass(frozen=True)
class DryRun:
    """Effects that a recording of a plan could show, those that it could not distinguish, and those
    that it could not show at all."""

    showings: tuple[Showing, ...]
    cannot_tell: tuple[str, ...]
    blind: tuple[BlindSpot, ...]


@one_thread
def dry_run(plan: Plan, samples: int = SAMPLES, rate: float = RATE) -> DryRun:
    """Rehearse a plan on the nominal robot with its sensor's noise.

    Args:
        plan: poses or a motion.
        samples: rows a pose.
        rate: rows a second [Hz].

    Raises:
        DiagnosisError: such a recording could not be diagnosed, and why.
    """
    prepared = of_plan(plan, None, samples, rate)
    d = build(prepared, prepared.configuration.robot_theta, tolerances(prepared))
    similarity = Similarity(d)
    design = Design(similarity, Searcher(d), RUNG)
    return DryRun(showings(design), cannot_tell(d, similarity), blind_spots([design]))
