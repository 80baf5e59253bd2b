"""One robot of a campaign: recorded in MuJoCo, calibrated, diagnosed, compared with its truth.

Moves between poses take their time but are not simulated (`wrenchbed record` steps MuJoCo through
each). Recordings at rest do not depend on them: joints are measured where the servos hold them.
"""

import json
import re
import time
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.calibration.calibrate import calibrate
from wrenchbed.calibration.fit import Fit
from wrenchbed.campaigns.rows import Row, empty
from wrenchbed.campaigns.setting import Fleet, Truth, draw, varied
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import Recording, joint_columns
from wrenchbed.errors import WrenchbedError
from wrenchbed.files import write_json
from wrenchbed.hardware.drivers.base.samples import as_designed
from wrenchbed.physics.noise import noise_model
from wrenchbed.planning.choose import poses
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.robots.motion_limits import Limits, duration
from wrenchbed.simulation.closed_form import Model
from wrenchbed.twin.replay import simulate
from wrenchbed.twin.twin import Twin

RATE_HZ = 100.0
"""Sampling rate at rest [Hz]."""
SETTLE_S = 0.5
"""Time from the end of a move to the first row [s]."""


def course(fleet: Fleet, k: int) -> Recording:
    """The recording of robot k with readings of 0."""
    robot = fleet.model_robot()
    plan = fleet.plan
    if plan is None:
        plan = poses(robot, fleet.poses, int(fleet.rng(k, "poses").integers(2**31)))
    if plan.mode == "dynamic":
        assert plan.rate_hz is not None  # `Plan` holds it
        t, rows, rate = np.arange(len(plan)) / plan.rate_hz, np.arange(len(plan)), plan.rate_hz
    else:
        t, rows, rate = *_rests(robot, plan, fleet.samples), RATE_HZ
    sensor = registry.load("sensors", robot.sensor)
    metadata = as_designed(
        robot, source="sim", mode=plan.mode, rate=rate, gravity=robot.gravity,
        sensor=sensor.name, noise_std=noise_model("real", sensor.noise).row_std,
    )  # fmt: skip
    q = plan.q[rows]
    columns = {"t": t, "segment": plan.segment[rows]}
    columns |= {f"q{j + 1}": q[:, j] for j in range(q.shape[1])}
    columns |= {c: np.zeros(len(t)) for c in ("fx", "fy", "fz", "tx", "ty", "tz")}
    assert joint_columns(columns)
    return Recording(metadata, columns, f"{fleet.robot} {k}")


def _rests(robot: SimulatedRobot, plan: Plan, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and poses of all rows (N,)."""
    here, now, begins = np.asarray(robot.home, dtype=float), 0.0, []
    speed = Limits().speed
    for q, dwell in zip(plan.q, plan.dwell, strict=True):
        now += duration(robot, here, q, speed) + SETTLE_S
        begins.append(now)
        now += max(samples / RATE_HZ, float(dwell))
        here = q
    within = np.arange(samples) / RATE_HZ
    t = (np.array(begins)[:, None] + within).ravel()
    return t, np.repeat(np.arange(len(plan)), samples)


_JUDGED, _SEED = 100, 20_160_798
"""Poses at which all robots are judged, and what they are drawn from."""
_EFFECT = re.compile(r"[a-z]+\.[a-z_]+")
"""An effect's name in a sentence."""
_COURSES: dict[str, Recording] = {}


def one(fleet: Fleet, k: int) -> Row:
    """The row of robot k; a named error of the package is reported in column ``error``."""
    row, begun = empty(fleet, k), time.perf_counter()
    try:
        recording, truth = recorded(fleet, k)
        row |= _of_truth(fleet, truth, recording)
        row["seconds.record"] = time.perf_counter() - begun
        begun = time.perf_counter()
        fit = calibrate(recording)
        row["seconds.calibrate"] = time.perf_counter() - begun
        row |= _of_fit(fleet, truth, fit)
        if fleet.diagnose:
            begun = time.perf_counter()
            row |= _diagnosed(fleet, truth, recording)
            row["seconds.diagnose"] = time.perf_counter() - begun
    except WrenchbedError as error:
        row["error"] = f"{type(error).__name__}: {error}"
    return row


def recorded(fleet: Fleet, k: int) -> tuple[Recording, Truth]:
    """What robot k's sensor read, by MuJoCo, and what it truly is."""
    if "poses" in fleet.vary:
        path = course(fleet, k)
    else:
        key = json.dumps(fleet.to_json())
        if key not in _COURSES:
            _COURSES.clear()
            _COURSES[key] = course(fleet, k)
        path = _COURSES[key]
    model = Model.of(fleet.model_robot())
    visited = path.q[np.r_[True, np.diff(path.columns["segment"]) != 0]]
    mode = path.metadata.mode
    truth = draw(fleet, k, model, path.q if mode == "dynamic" else visited, mode)
    seed = int(fleet.rng(k, "noise").integers(2**31))
    twin = Twin(model, truth.theta, truth.active)
    return simulate(twin, path, noise="real", seed=seed), truth


def _of_truth(fleet: Fleet, truth: Truth, recording: Recording) -> Row:
    model = Model.of(fleet.model_robot())
    row: Row = {"rows": len(recording), "effect": truth.effect, "size": truth.size}
    if truth.active:
        row["added"] = _added(truth, model, recording)
    row["values"] = json.dumps({n: float(v) for n, v in truth.values.items()})
    for i in varied(model):
        row[f"true.{model.parameters.names[i]}"] = float(truth.theta[i])
    return row


def _added(truth: Truth, model: Model, recording: Recording) -> float:
    """Mean square change of a reading by the effect, in units of one row's noise."""
    without, with_ = (
        simulate(Twin(model, truth.theta, active), recording).wrench
        for active in ((), truth.active)
    )
    noise = np.array(recording.metadata.sensor.noise_std)
    return float(np.mean(((with_ - without) / noise) ** 2))


def _of_fit(fleet: Fleet, truth: Truth, fit: Fit) -> Row:
    model = Model.of(fleet.model_robot())
    row: Row = {"converged": fit.converged, "rank": fit.observability.rank}
    inside = []
    for p in fit.identified:
        row[f"fit.{p.name}"] = p.value
        if p.std is not None and p.interval95 is not None:
            row[f"std.{p.name}"] = p.std
            true = truth.theta[model.parameters.index(p.name)]
            inside.append(abs(p.value - true) <= p.interval95)
    row["inside95"] = float(np.mean(inside)) if inside else float("nan")
    for part, k in (("force", 0), ("torque", 3)):
        row[f"residual.{part}"] = float(np.sqrt(np.mean(fit.residual_rms[k : k + 3] ** 2)))
    fitted = model.parameters.vector(dict(fit.theta))
    for when, theta in (("before", model.parameters.nominal), ("after", fitted)):
        for what, error in _errors(fleet.robot, model, truth.theta, theta).items():
            row[f"{what}.{when}"] = error
    return row


def _errors(name: str, model: Model, true: np.ndarray, theta: np.ndarray) -> dict[str, float]:
    """Rms over fresh poses of the reading [N, N·m], and of the tool's position [m], if it has one.

    Rigid robots are compared: an effect is neither in truth nor in what is judged.
    """
    q, target = judged(name)
    off = model.predict(q, theta) - model.predict(q, true)
    errors = {
        what: float(np.sqrt(np.nanmean((off[:, k : k + 3] ** 2).sum(axis=1))))
        for what, k in (("force", 0), ("torque", 3))
    }
    if target is not None:
        n_robot = len(model.robot.parameters)
        places = [model.robot.tool_pose(target, x[:n_robot])[1] for x in (true, theta)]
        apart = ((places[1] - places[0]) ** 2).sum(axis=1)
        errors["position"] = float(np.sqrt(np.nanmean(apart)))
    return errors


@cache
def judged(name: str) -> tuple[np.ndarray, np.ndarray | None]:
    """Poses (100, J) at which readings are judged, and those (G, J) for positions, if any."""
    robot: SimulatedRobot = Fleet(name, 1).model_robot()
    return robot.sample(_JUDGED, np.random.default_rng(_SEED)), robot.target()


def _diagnosed(fleet: Fleet, truth: Truth, recording: Recording) -> Row:
    from wrenchbed.diagnosis.diagnose import diagnose

    d = diagnose(recording).diagnosis
    claimed = [str(w["effect"]) for w in d.which]
    named = claimed + [str(r) for w in d.which for r in w["rivals"]]
    row: dict[str, Any] = {
        "verdict": d.verdict,
        "claimed": " ".join(claimed),
        "named": " ".join(named),
        "alike": " ".join(sorted({n for text in d.cannot_tell for n in _EFFECT.findall(text)})),
        "probability": float(d.which[0]["probability"]) if d.which else float("nan"),
        "where": str(d.where[0]["subsystem"]) if d.where else "",
        "gap.configured": _number(d.gap.configured),
        "gap.calibrated": _number(d.gap.calibrated),
        "gap.with_effects": _number(d.gap.with_effects),
        "closed": _number(d.gap.closed),
    }
    if truth.effect:
        row["right"] = float(d.verdict == "identified" and truth.effect in claimed)
    elif "parameters" not in fleet.vary:
        row["right"] = float(d.verdict == "none")
    return row


def _number(x: float | None) -> float:
    return float("nan") if x is None else float(x)


def write_one(fleet: Fleet, k: int, folder: Path) -> Row:
    """Work on robot ``k`` again, and write rec.parquet, fit.json and row.json into a folder."""
    recording, _ = recorded(fleet, k)
    recording.write(folder / "rec.parquet")
    calibrate(Recording.read(folder / "rec.parquet")).write(folder / "fit.json")
    row = {n: v for n, v in one(fleet, k).items() if v == v}  # without NaN
    write_json(folder / "row.json", row)
    return row
