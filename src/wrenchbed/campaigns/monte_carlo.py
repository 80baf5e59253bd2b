"""Many simulated robots, a row each: recorded in MuJoCo, calibrated, compared with their truth.

Row k of a campaign is a function of the settings (`Fleet`) and of k alone.

Moves between poses take their time but are not simulated (`wrenchbed record` steps MuJoCo through
each). Recordings at rest do not depend on them: joints are measured where the servos hold them.
"""

import hashlib
import json
import time
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from wrenchbed import registry
from wrenchbed.calibration.calibrate import calibrate
from wrenchbed.calibration.fit import Fit
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import Recording
from wrenchbed.errors import FleetError, ParameterError, WrenchbedError, raise_shortage
from wrenchbed.files import write_text
from wrenchbed.hardware.drivers.base import as_designed
from wrenchbed.jobs.finished_parts import Parts, Row, check_folders, read_table, run, write_table
from wrenchbed.jobs.workers import Progress, silent
from wrenchbed.physics.noise import noise_model
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.planning.choose import poses
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.robots.checked_moves import Limits, duration
from wrenchbed.simulation.closed_form import Model
from wrenchbed.twin.replay import simulate
from wrenchbed.twin.twin import Twin

RATE_HZ = 100.0
"""Sampling rate at rest [Hz]."""
SETTLE_S = 0.5
"""Time from the end of a move to the first row [s]."""
_JUDGED, _SEED = 100, 20_160_798
"""Number of test poses at which all robots are judged, and the seed that draws them."""
ALL, SETTING, PARTS = "robots.parquet", "campaign.json", "parts"
"""In a campaign's folder: file of all rows, file of the settings, folder of rows while it works."""
SECONDS = ("seconds.record", "seconds.calibrate")
"""Columns of durations: the only ones that differ between equal runs."""
_INTEGER = ("rows", "rank")
_NUMBER = ("inside95", "residual.force", "residual.torque")
_ERRORS = tuple(f"{x}.{w}" for x in ("force", "torque", "position") for w in ("before", "after"))
VARIED = ("noise", "parameters", "poses")
"""Properties that may differ from robot to robot."""
_STREAMS = {"noise": 0, "parameters": 1, "poses": 3}
"""Stream of random numbers by what is drawn from it; another number would make other robots."""
_MOST = 1_000_000
"""Most robots, poses of each, and rows a pose: an estimate; more would fill the memory first."""
_TRIES = 50
"""Most random draws to find a robot that reaches all poses."""


@dataclass(frozen=True, eq=False)
class Fleet:
    """Settings of a campaign of many robots of one kind; row k follows from these and from k alone.

    Attributes:
        robot: registry name.
        robots: number of robots.
        vary: names of `VARIED` that are drawn for each robot; the others (noise, nominal
            parameters, poses) are the same for all.
        poses: number of poses of each robot, where no plan is given.
        samples: rows a pose.
        seed: not negative.
        plan: plan that all robots run; None: each its own.
    """

    robot: str
    robots: int
    vary: tuple[str, ...] = ("noise", "parameters")
    poses: int = 100
    samples: int = 50
    seed: int = 0
    plan: Plan | None = None

    def __post_init__(self) -> None:
        for what in self.vary:
            if what not in VARIED:
                raise ParameterError(f"--vary {what}: known are {', '.join(VARIED)}")
        for name in ("robots", "poses", "samples"):
            if not 1 <= getattr(self, name) <= _MOST:
                raise ParameterError(f"--{name} {getattr(self, name)}: give 1 to {_MOST:,}")
        if self.seed < 0:
            raise ParameterError(f"seed {self.seed} must not be negative")
        if self.plan is not None:
            if "poses" in self.vary:
                raise ParameterError("--vary poses and --plan, the same for all: leave one out")
            if self.plan.robot != registry.known_as("robots", self.robot):
                raise ParameterError(
                    f"{self.plan.name}: the plan is for robot {self.plan.robot!r}, "
                    f"not {self.robot!r}"
                )
            if self.plan.points is not None:
                raise ParameterError(f"{self.plan.name}: holds touches; give a plan of poses")
        self.model_robot()

    def model_robot(self) -> SimulatedRobot:
        """The campaign's robot, nominal; a `ParameterError` if it cannot be simulated."""
        robot = registry.load("robots", self.robot)
        if not isinstance(robot, SimulatedRobot):
            raise ParameterError(f"robot {self.robot!r} has no model to simulate")
        return robot

    def rng(self, k: int, what: str) -> np.random.Generator:
        """Random generator of robot k for ``what``, one of `VARIED`; the same for all k if ``vary``
        has it not."""
        robot = k + 1 if what in self.vary else 0
        return np.random.default_rng([self.seed, robot, _STREAMS[what]])

    def to_json(self) -> dict[str, Any]:
        """Settings that determine the rows, as JSON; without the number of robots."""
        plan = None
        if self.plan is not None:
            plan = hashlib.sha256(np.ascontiguousarray(self.plan.q).tobytes()).hexdigest()
        return {
            "robot": self.robot, "vary": sorted(self.vary), "poses": self.poses,
            "samples": self.samples, "seed": self.seed, "plan": plan,
        }  # fmt: skip


def varied(model: Model) -> tuple[int, ...]:
    """Indices of the parameters that differ from robot to robot: those `calibrate` identifies."""
    return model.parameters.select(model.robot.free)


def draw(fleet: Fleet, k: int, model: Model, q: np.ndarray) -> np.ndarray:
    """Draw true parameters (P,) of robot k, uniform within tolerances, with which it reaches q (N,
    J); a `ParameterError` if no robot within tolerance reaches them all."""
    if "parameters" not in fleet.vary:
        return np.array(model.parameters.nominal)
    rng, robot = fleet.rng(k, "parameters"), fleet.model_robot()
    columns, n_robot = list(varied(model)), len(robot.parameters)
    tolerance = model.parameters.tolerance[columns]
    for _ in range(_TRIES):
        theta = np.array(model.parameters.nominal)
        theta[columns] += rng.uniform(-1.0, 1.0, len(columns)) * tolerance
        if not robot.infeasible(q, theta[:n_robot]):
            return theta
    raise ParameterError(
        f"no {robot.name} within tolerance reaches all poses: plan poses further from its limits"
    )


def schema(fleet: Fleet) -> pa.Schema:
    """Columns of a fleet's rows; units are SI, see docs/how-to/campaigns.md."""
    model = Model.of(fleet.model_robot())
    names = [model.parameters.names[i] for i in varied(model)]
    parameters = [f"{part}.{n}" for n in names for part in ("true", "fit", "std")]
    columns = [("robot", pa.int64()), ("seed", pa.int64()), ("error", pa.string())]
    columns += [(n, pa.int64()) for n in _INTEGER] + [("converged", pa.bool_())]
    columns += [(n, pa.float64()) for n in (*_NUMBER, *_ERRORS, *parameters, *SECONDS)]
    return pa.schema(columns)


@lru_cache(1)  # robots that share their poses share it
def course(fleet: Fleet, k: int) -> Recording:
    """Recording of robot k before simulation: its times and joint values; readings are 0 in it."""
    robot = fleet.model_robot()
    plan = fleet.plan
    if plan is None:
        plan = poses(robot, fleet.poses, int(fleet.rng(k, "poses").integers(2**31)))
    if plan.mode == "dynamic" and plan.rate_hz is not None:
        t, rows, rate = np.arange(len(plan)) / plan.rate_hz, np.arange(len(plan)), plan.rate_hz
    else:
        t, rows, rate = *_rests(robot, plan, fleet.samples), RATE_HZ
    sensor = registry.load("sensors", robot.sensor)
    metadata = as_designed(
        robot, source="sim", mode=plan.mode, rate=rate, gravity=robot.gravity,
        sensor=sensor.name, noise_std=noise_model("real", sensor.noise).row_std,
    )  # fmt: skip
    columns = {"t": t, "segment": plan.segment[rows]}
    columns |= {f"q{j + 1}": q[rows] for j, q in enumerate(plan.q.T)}
    columns |= {c: np.zeros(len(t)) for c in CHANNELS}
    return Recording(metadata, columns, fleet.robot)


def _rests(robot: SimulatedRobot, plan: Plan, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Times (N,) [s] and joint values (N, J) of all rows of a plan at rest."""
    here, now, begins = np.asarray(robot.home, dtype=float), 0.0, []
    speed = Limits().speed
    for q, dwell in zip(plan.q, plan.dwell, strict=True):
        now += duration(robot, here, q, speed) + SETTLE_S
        begins.append(now)
        now += max(samples / RATE_HZ, float(dwell))
        here = q
    t = (np.array(begins)[:, None] + np.arange(samples) / RATE_HZ).ravel()
    return t, np.repeat(np.arange(len(plan)), samples)


def robot_row(fleet: Fleet, k: int) -> Row:
    """Simulate and calibrate robot k: its row of the table, with an error's text in ``error``."""
    row, begun = Row(robot=k, seed=fleet.seed, error=""), time.perf_counter()
    try:
        recording, theta = recorded(fleet, k)
        model = Model.of(fleet.model_robot())
        row |= {f"true.{model.parameters.names[i]}": float(theta[i]) for i in varied(model)}
        row["rows"] = len(recording)
        now = time.perf_counter()
        row["seconds.record"], begun = now - begun, now
        fit = calibrate(recording)
    except WrenchbedError as error:
        return row | {"error": f"{type(error).__name__}: {error}"}
    row["seconds.calibrate"] = time.perf_counter() - begun
    return row | _of_fit(fleet, theta, fit) | _errors(fleet, theta, fit)


def recorded(fleet: Fleet, k: int) -> tuple[Recording, np.ndarray]:
    """Simulate the recording of robot k: the recording, and the robot's true parameters (P,)."""
    model = Model.of(fleet.model_robot())
    path = course(fleet, k if "poses" in fleet.vary else 0)
    first = np.r_[True, np.diff(path.columns["segment"]) != 0]  # row of each rest
    visited = path.q if path.metadata.mode == "dynamic" else path.q[first]
    twin, seed = Twin(model, draw(fleet, k, model, visited)), fleet.rng(k, "noise").integers(2**31)
    return simulate(twin, path, noise="real", seed=int(seed)), twin.theta


def _of_fit(fleet: Fleet, theta: np.ndarray, fit: Fit) -> Row:
    model = Model.of(fleet.model_robot())
    row: Row = {"converged": fit.converged, "rank": fit.observability.rank}
    inside = []
    for p in fit.identified:
        row[f"fit.{p.name}"] = p.value
        if p.std is not None and p.interval95 is not None:
            row[f"std.{p.name}"] = p.std
            true = theta[model.parameters.index(p.name)]
            inside.append(abs(p.value - true) <= p.interval95)
    row["inside95"] = float(np.mean(inside)) if inside else float("nan")
    for part, k in (("force", 0), ("torque", 3)):
        row[f"residual.{part}"] = float(np.sqrt(np.mean(fit.residual_rms[k : k + 3] ** 2)))
    return row


def _errors(fleet: Fleet, true: np.ndarray, fit: Fit) -> Row:
    """Columns of a robot's row, before and after calibration: rms errors over test poses of
    readings [N, N·m], and of tool positions [m] if it has a tip; ``true``: true parameters (P,)."""
    model, row = Model.of(fleet.model_robot()), Row()
    q, target = judged(fleet.robot)
    fitted = model.parameters.vector(dict(fit.theta))
    for when, theta in (("before", model.parameters.nominal), ("after", fitted)):
        off = model.predict(q, theta) - model.predict(q, true)
        vectors = {"force": off[:, :3], "torque": off[:, 3:]}
        if target is not None:
            robot_parameters, robot = len(model.robot.parameters), model.robot
            places = [robot.tool_pose(target, x[:robot_parameters])[1] for x in (true, theta)]
            vectors["position"] = places[1] - places[0]
        for what, error in vectors.items():  # where a tool cannot reach, it has no position
            row[f"{what}.{when}"] = float(np.sqrt(np.nanmean((error**2).sum(axis=1))))
    return row


@cache
def judged(name: str) -> tuple[np.ndarray, np.ndarray | None]:
    """Test poses of a robot by name: for readings (100, J); for positions in its target workspace
    (G, J) or None."""
    robot: SimulatedRobot = Fleet(name, 1).model_robot()
    return robot.sample(_JUDGED, np.random.default_rng(_SEED)), robot.target()


def campaign(
    fleet: Fleet, folder: str | Path, *, workers: int = 2, progress: Progress = silent
) -> pa.Table:
    """Record and calibrate many simulated robots: one row each.

    Robots whose rows are in the folder already are not simulated again.

    Args:
        folder: gets ``robots.parquet`` and, while it works, ``parts/``.
        progress: called with the number of robots finished since its last call.

    Raises:
        FleetError: the folder holds another campaign, files of something else, or broken rows.
        WorkerError: a worker died. Finished rows are kept; the same call continues.
        OSError: the disk is full; finished rows are kept, too.
    """
    place, settings = Path(folder), fleet.to_json()
    check_folders(place / SETTING, settings, [place], FleetError)
    write_text(place / SETTING, json.dumps(settings, indent=1))
    columns = schema(fleet)
    table, parts = columns.empty_table(), Parts(place / PARTS, "robot-", columns)
    if (place / ALL).exists():
        try:
            table = read_table(place / ALL, columns)
        except pa.ArrowException as cause:
            raise_shortage(cause, place / ALL)
            raise FleetError(f"{place / ALL}: is broken: {cause}; remove it") from cause
    done = set(table["robot"].to_pylist())
    progress(len(done.intersection(range(fleet.robots))))
    todo = sorted({*range(fleet.robots), *parts.numbers()} - done)
    table = pa.concat_tables([table, run(_rows, fleet, todo, parts, progress, workers)])
    table = table.sort_by("robot")
    write_table(place / ALL, table)
    parts.remove()
    return table


def _rows(fleet: Fleet, k: int) -> list[Row]:
    return [robot_row(fleet, k)]
