"""Rehearsal of a plan on a nominal robot with its sensor's noise: what could it show?"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from wrenchbed import registry
from wrenchbed.data.metadata import Metadata, SensorInfo
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import QUATERNION, Recording
from wrenchbed.diagnosis.evidence.dictionary import build
from wrenchbed.diagnosis.evidence.search import Searcher
from wrenchbed.diagnosis.next.actions import TURNS_S
from wrenchbed.diagnosis.next.blind import BlindSpot, Design, Showing, blind_spots, showings
from wrenchbed.diagnosis.prepare import scenes
from wrenchbed.diagnosis.prepare.bias_and_load_fit import tolerances
from wrenchbed.diagnosis.prepare.configured_simulator import Configuration
from wrenchbed.diagnosis.prepare.prepare_recording import prepare
from wrenchbed.diagnosis.prepare.prepared import Prepared
from wrenchbed.effects.chain import respond
from wrenchbed.errors import DiagnosisError
from wrenchbed.jobs.workers import one_thread
from wrenchbed.physics.noise import NoiseStream
from wrenchbed.physics.taylor_jets import Jet
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.base import Robot
from wrenchbed.robots.checked_moves import duration
from wrenchbed.simulation.closed_form import Model

SAMPLES, RATE, SEED = 60, 100.0, 0
"""Rows at a pose, their rate [Hz], and the seed of their noise."""
RUNG = 1
"""Index of the assumed background level (size of imperfections): middle one of healthy robots."""


def of_plan(plan: Plan, samples: int = SAMPLES, rate: float = RATE) -> Prepared:
    """Prepare what a nominal robot would record for a plan, in closed form.

    ``samples`` a pose and ``rate`` [Hz] hold where the plan states none.

    Raises:
        DiagnosisError: such a recording could not be diagnosed, and why.
        NotFoundError: there is no such robot.
    """
    if plan.points is not None:
        raise DiagnosisError(f"{plan.name}: a plan of touches records no free load to diagnose")
    robot: Robot = registry.load("robots", plan.robot)
    rate = float(plan.rate_hz or rate)
    sensor, tool = registry.load("sensors", robot.sensor), robot.tool(robot.parameters.nominal)
    noise = SensorInfo(sensor.name, tuple(sensor.noise.row_std.tolist()))
    metadata = Metadata.of(robot.name, plan.mode, "plan", rate, tool, noise, robot.gravity)
    model = Model.of(robot, metadata)
    robot_theta = Configuration(model, model.configured(metadata)).robot_theta
    if plan.mode == "dynamic":
        t, count = np.arange(len(plan)) / rate, np.ones(len(plan), dtype=int)
        d = np.gradient(plan.q, 1.0 / rate, axis=0)
        jet = Jet(plan.q, d, np.gradient(d, 1.0 / rate, axis=0))
        clean = respond(scenes.of_motion(model, robot_theta, jet, t, None))
    else:
        dwelt = np.where(plan.dwell > 0, np.round(plan.dwell * rate), samples)
        count = np.maximum(dwelt, 1).astype(int)
        moves = [duration(robot, *ends) if robot.joints else TURNS_S for ends in pairwise(plan.q)]
        start = np.cumsum([0.0, *(np.asarray(moves) + count[:-1] / rate)])
        scene = scenes.of_poses(model, robot_theta, plan.q, start + count / (2 * rate), None)
        clean = np.repeat(respond(scene)[scene.held], count, axis=0)
        within = np.arange(len(clean)) - np.repeat(np.cumsum(count) - count, count)
        t = np.repeat(start, count) + within / rate
    rows, _ = NoiseStream(sensor.noise, SEED).corrupt(t, clean)
    names = [f"q{j + 1}" for j in range(len(robot.joints))] or list(QUATERNION)
    columns = {"t": t} | {n: np.repeat(plan.q[:, j], count) for j, n in enumerate(names)}
    columns |= {c: np.asarray(rows)[:, k] for k, c in enumerate(CHANNELS)}
    columns["segment"] = np.repeat(plan.segment, count)
    return prepare(Recording(metadata, columns, plan.name))


@dataclass(frozen=True)
class DryRun:
    """Effects that a plan's recording could show, each with those like it, and its blind spots."""

    showings: tuple[Showing, ...]
    blind: tuple[BlindSpot, ...]


@one_thread
def dry_run(plan: Plan, samples: int = SAMPLES, rate: float = RATE) -> DryRun:
    """Rehearse a plan of poses or a motion on the nominal robot with its sensor's noise.

    ``samples`` and ``rate`` as for `of_plan`.

    Raises:
        DiagnosisError: such a recording could not be diagnosed, and why.
    """
    prepared = of_plan(plan, samples, rate)
    d = build(prepared, prepared.configuration.robot_theta, tolerances(prepared))
    design = Design(Searcher(d), RUNG)
    return DryRun(showings(design), blind_spots([design]))
