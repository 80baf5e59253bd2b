"""Beyond the paper: errors in all 49 parameters, measurements that identify them, and a plan."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
from scipy.spatial.transform import Rotation

from wrenchbed.calibration.accuracy import Goal, tip_jacobian
from wrenchbed.calibration.calibrate import CANDIDATES, CalibrationOptions, calibrate
from wrenchbed.calibration.touches import Touches
from wrenchbed.campaigns.recording.run import record
from wrenchbed.data.recording import Recording
from wrenchbed.hardware.drivers.sim import SimDriver, SimOptions
from wrenchbed.jobs.parts import Row
from wrenchbed.pages.document import Figure, Section, Table
from wrenchbed.pages.plots import bars
from wrenchbed.planning.accuracy_plan import Mix, reach
from wrenchbed.simulation.simulation import Simulation
from wrenchbed.studies.medrue.identifiability import TOUCHES, in_reach, kinds
from wrenchbed.studies.medrue.identification import as_the_paper
from wrenchbed.studies.medrue.setting import PAPER, PoseDesign, StudySetting

WANTED = 3e-4
"""Accuracy that the plan must reach [m]."""
ROBOTS = 200
"""Number of robots with errors in all parameters."""
_UNIFORM = 1 / np.sqrt(3.0)
"""Standard deviation of a uniform draw over its half width."""


@dataclass(frozen=True, eq=False)
class AllWrong:
    """Position errors of robots with errors in all parameters; (robots,) each, SI.

    ``after`` calibration from exact wrenches, and further after the best ``rigid`` motion and
    after a ``similar`` one, with scale.
    """

    before: np.ndarray
    after: np.ndarray
    rigid: np.ndarray
    similar: np.ndarray
    residual: np.ndarray


def draw(
    setting: StudySetting, rng: np.random.Generator, extra: tuple[str, ...] = ()
) -> np.ndarray:
    """Parameters (P,) with every candidate (and ``extra``) uniform within its tolerance.

    The mass stays nominal unless it is extra.
    """
    names = setting.model.parameters
    theta = setting.theta.copy()
    for c in names.select([*setting.robot.candidates, *extra]):
        if names[c].unit != "kg" or names[c].name in extra:
            theta[c] += rng.uniform(-1.0, 1.0) * names[c].tolerance
    return theta


def all_wrong(setting: StudySetting, chosen: np.ndarray, seed: int, robots: int) -> AllWrong:
    """Identify the 27 from MuJoCo's exact wrenches of robots whose 49 are all wrong."""
    rows = []
    own = len(setting.robot.parameters)
    for k in range(robots):
        theta = draw(setting, np.random.default_rng([seed, 20_000, k]))
        simulation = Simulation(setting.robot, theta[:own])
        q = setting.q[chosen]
        wrench = simulation.wrench(q)
        identified = as_the_paper(setting, q, wrench).theta
        true = simulation.tip(setting.target)
        before, after = (_tips(setting, t) for t in (setting.theta, identified))
        residual = np.abs(wrench - setting.model.predict(q, identified)).max()
        remaining = (_aligned(after, true, scale) for scale in (False, True))
        errors = (before - true, after - true, *remaining)
        rows.append((*map(_rms, errors), residual))
    return AllWrong(*np.array(rows).T)


def _tips(setting: StudySetting, theta: np.ndarray) -> np.ndarray:
    """Tool positions (T, 3) in the target in closed form."""
    return setting.robot.tool_pose(setting.target, setting.robot.robot_theta(theta))[1]


def _aligned(points: np.ndarray, true: np.ndarray, scale: bool) -> np.ndarray:
    """Errors (T, 3) after the best rigid motion, with or without scale.

    Umeyama 1991, doi 10.1109/34.88573.
    """
    a, b = points - points.mean(axis=0), true - true.mean(axis=0)
    rotation, _ = Rotation.align_vectors(b, a)
    rotated = rotation.apply(a)
    factor = float((rotated * b).sum() / (rotated**2).sum()) if scale else 1.0
    return np.asarray(b - factor * rotated)


def _rms(error: np.ndarray) -> float:
    return float(np.sqrt((error**2).sum(axis=-1).mean()))


@dataclass(frozen=True, eq=False)
class Confirming:
    """Data shared by all confirming robots."""

    setting: StudySetting
    mix: Mix
    seed: int
    folder: Path


def confirm(shared: Confirming, number: int) -> list[Row]:
    """Result of one robot with errors in all parameters and the bias: record the plan in MuJoCo
    with the Mini40's noise, calibrate, and compare its tool with the true one's in the target."""
    setting, mix = shared.setting, shared.mix
    rng = np.random.default_rng([shared.seed, 30_000, number])
    theta = draw(setting, rng, ("mTool", "sensor.bias"))
    names = setting.model.parameters
    differs = {
        n: float(v) for n, v in names.mapping(theta).items() if v != names[names.index(n)].nominal
    }
    files = [shared.folder / f"confirm-{number:03d}.{k}.parquet" for k in ("poses", "touches")]
    with SimDriver(
        SimOptions(setting.robot.name, parameters=differs, seed=1000 * shared.seed + number)
    ) as driver:
        record(driver, mix.gravity, files[0])
        record(driver, mix.touches, files[1], samples=5)
    options = CalibrationOptions(free=(CANDIDATES, "sensor.bias"), prior=True)
    fit = calibrate(Recording.read(files[0]), options, Touches.of(Recording.read(files[1])))
    for file in files:
        file.unlink()
    own = len(setting.robot.parameters)
    true = Simulation(setting.robot, theta[:own]).tip(setting.target)
    before, after = (
        _tips(setting, t) - true for t in (setting.theta, names.vector(dict(fit.theta)))
    )
    worst = float(np.linalg.norm(after, axis=1).max())
    row = {"robot": number, "before": _rms(before), "after": _rms(after), "worst": worst}
    return [row | {"converged": fit.converged}]


def plan(setting: StudySetting, seed: int) -> Mix:
    """Plan of few measurements that assures `WANTED`."""
    return reach(setting.robot, WANTED, seed=seed)


def section(
    setting: StudySetting,
    designs: dict[str, PoseDesign],
    wrong: AllWrong,
    mix: Mix,
    confirmed: pa.Table,
    seed: int,
) -> Section:
    """Section on errors in all parameters, remedies, and the plan."""
    added, figure = _added(setting, designs, seed)
    return Section(
        "Beyond: when nothing about the robot is known exactly",
        "The paper's simulated robot has no error in the 22 parameters that it freezes. Give every "
        "parameter ±2 mm, ±1° and the wrench is still explained exactly, but the tool is not where "
        "the model says: force validation cannot see it.",
        (_all_wrong(wrong), added, figure, _plan(mix, confirmed)),
    )


def _all_wrong(wrong: AllWrong) -> Table:
    rows = [
        ("before", 1e3 * _mean(wrong.before)), ("after, no noise at all", 1e3 * _mean(wrong.after)),
        ("of which rigid motion of base and tool does not explain", 1e3 * _mean(wrong.rigid)),
        ("of which motion and overall scale do not explain", 1e3 * _mean(wrong.similar)),
        ("largest wrench residual [N, N·m]", float(wrong.residual.max())),
    ]  # fmt: skip
    share = 1 - _mean(wrong.rigid) / _mean(wrong.after)
    return Table.of(
        f"{len(wrong.after)} robots with all parameters in error: rms position error in the target",
        ("case", "mean over robots [mm]"), rows,
        f"A rigid motion of base and tool takes {100 * share:.0f} % of it away.",
    )  # fmt: skip


def _mean(values: np.ndarray) -> float:
    return float(values.mean())


def _added(
    setting: StudySetting, designs: dict[str, PoseDesign], seed: int
) -> tuple[Table, Figure]:
    names = setting.model.parameters
    columns = names.select(setting.robot.candidates)
    prior = names.tolerance[list(columns)] * _UNIFORM
    goal = Goal(tip_jacobian(setting.robot, setting.target, setting.theta, columns))
    turn = [names.names[c] for c in columns].index("alpha0")
    rows = [
        (
            kind.name, kind.count, rank, np.rad2deg(np.sqrt(covariance[turn, turn])),
            1e3 * goal.rms(covariance),
        )
        for kind, rank, covariance in in_reach(
            kinds(setting, designs["O1"].chosen, PAPER.std, seed), prior
        )
    ]  # fmt: skip
    note = (
        "Priors are the standard deviations of uniform draws within ±2 mm, ±1°; wrenches ±1 N as "
        "3σ, 100 averaged; "
        f"{TOUCHES} touches with 0.05 mm per axis. Rank of 49: tool orientation αT βT γT and pins "
        "d31 d32 move no tool tip. What stands at an unknown place cannot show the base's turn α0 "
        "about the vertical."
    )
    table = Table.of(
        "What brings the tool into reach",
        ("measurement", "number", "rank", "posterior α0 [°]", "posterior position [mm rms]"),
        rows, note,
    )  # fmt: skip
    figure = Figure(
        "added", "Posterior position error with an added measurement",
        bars({r[0]: float(r[4]) for r in rows}, "rms position error [mm]", log=True),
    )  # fmt: skip
    return table, figure


def _plan(mix: Mix, confirmed: pa.Table) -> Table:
    after, before, worst = (1e3 * confirmed[k].to_numpy() for k in ("after", "before", "worst"))
    good = int((after < 1e3 * WANTED).sum())
    rows: list[tuple[str, object]] = [
        ("poses under gravity", len(mix.gravity)), ("touches of known points", len(mix.touches)),
        ("expected rms before [mm]", 1e3 * mix.before), ("expected rms after [mm]", 1e3 * mix.rms),
        (f"assured for {100 * mix.share:g} % of robots [mm]", 1e3 * mix.assured),
        ("simulated robots", len(after)),
        ("rms before, over robots [mm]", float(np.sqrt((before**2).mean()))),
        ("rms after, over robots [mm]", float(np.sqrt((after**2).mean()))),
        ("largest rms of a robot [mm]", float(after.max())),
        ("largest error anywhere in the target [mm]", float(worst.max())),
        (f"robots below {1e3 * WANTED:g} mm", f"{good} of {len(after)}"),
    ]  # fmt: skip
    return Table.of(
        f"A plan for {1e3 * WANTED:g} mm with all parameters and the sensor's bias unknown",
        ("quantity", "value"), rows,
        "wrenchbed plan medrue --goal target-position. Each robot was moved, touched and read in "
        "MuJoCo with the Mini40's noise, and calibrated from the files alone. The first "
        "three errors are those of the plan's rehearsal in closed form. The accuracy is the rms "
        "over the target; single places may be worse.",
    )  # fmt: skip
