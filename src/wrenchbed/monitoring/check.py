"""The monthly check of one robot: a recording of a few poses, compared with all earlier ones.

A comparison of the last 1, 2, 4 and 8 checks with those before them, by the rules of `compare`. Its
σ is that of the scatter from check to check, see `steps`. False alarms are budgeted over time:
`ALARMS_A_YEAR` is spent in proportion to the time since the check before.
"""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from wrenchbed import registry
from wrenchbed.calibration.compensated import restored
from wrenchbed.calibration.observations import observe
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import Recording
from wrenchbed.effects.chain import effects
from wrenchbed.effects.scene import Scene
from wrenchbed.errors import (
    HistoryError,
    PlanError,
    RecordingError,
    WrenchbedError,
    WrenchbedWarning,
)
from wrenchbed.monitoring import history
from wrenchbed.monitoring.compare import LEVEL, Change, changes_of
from wrenchbed.monitoring.history import RECORDINGS, Check, digest, digest_of
from wrenchbed.monitoring.steps import FITTED, NUMBERS, History, Step, tangents
from wrenchbed.pages.numbers import p_value, rough
from wrenchbed.planning.clearance import Clearance
from wrenchbed.planning.criteria import INDICES
from wrenchbed.planning.exchange import Pool, exchange
from wrenchbed.robots.base import Robot, SimulatedRobot
from wrenchbed.robots.motion_limits import duration

PLAN = "plan.parquet"
"""Name of the plan in the folder of a history."""
HEALTHY, CHANGED, CANNOT_TELL = "healthy", "changed", "cannot tell"
ALARMS_A_YEAR = 0.01
"""Probability of a false alarm in a year of checks of a healthy robot."""
SINCE = {1: 0.5, 2: 0.25, 4: 0.125, 8: 0.125}
"""Checks since a change, and the fraction of the budget that is spent on such changes."""
MISFIT = "misfit"
"""Name of what the numbers do not explain; a quarter of the budget is spent on it."""
LEAST = 4
"""Checks since the last baseline from which a robot may be called healthy: three show the ordinary
scatter, with the sensor's data."""
SAMPLES, RATE_HZ = 200, 100.0
"""Rows a pose and their rate [Hz]: a mean of 2 s is as good as 1/f noise lets it be."""
_POSES, _POOL = 12, 2000
"""Poses of a check, of which the last is the first again, and candidates."""
_UNLIKELY = 3.0
"""Log evidence by which a check is no longer a candidate for the first after a change: 20 to 1."""
_STATED = "check"
"""Field of a recording's metadata with what a check states: time, temperature, baseline."""
_FAR = 0.02
"""Largest distance of a pose from the plan's [rad or m]: a readings' change by 0.02 rad of another
orientation is corrected at the joint values that were measured."""
_EXAMPLES = ("sensor.bias.fz", "tool.mass", "base.tilt.x")
"""Numbers whose smallest visible step a headline states."""


@dataclass(frozen=True)
class Judgement:
    """What a history says of its last check.

    Attributes:
        verdict: `HEALTHY`, `CHANGED` or `CANNOT_TELL`.
        headline: what a person should know first.
        history: checks since the last baseline.
        alarms: names of numbers, or `MISFIT`, that the last check found changed.
        begin: first check after a change, of those since the baseline; None without one.
        within: first and last check that may be that.
        changes: all numbers before and after the change, the changed ones marked.
        misfit: whether what the numbers do not explain changed too.
    """

    verdict: str
    headline: str
    history: History
    alarms: tuple[str, ...] = ()
    begin: int | None = None
    within: tuple[int, int] | None = None
    changes: tuple[Change, ...] = ()
    misfit: bool = False

    @property
    def checks(self) -> Sequence[Check]:
        """Checks since the last baseline."""
        return self.history.checks

    def to_json(self) -> dict[str, Any]:
        """As a JSON object."""
        last, visible = self.checks[-1], _visible(self.history)
        known = zip(NUMBERS.items(), self.history.values[-1], self.history.std, strict=True)
        change: dict[str, Any] | None = None
        if self.begin is not None and self.within is not None:
            times, (low, high) = [c.time.isoformat() for c in self.checks], self.within
            change = {
                "after": times[self.begin - 1],
                "before": times[self.begin],
                "between": [times[low - 1], times[high]],
                "quantities": [asdict(c) for c in self.changes if c.changed],
                "misfit": self.misfit,
            }
        return {
            "format": 2,
            "robot": last.robot,
            "verdict": self.verdict,
            "headline": self.headline,
            "since": self.checks[0].time.isoformat(),
            "time": last.time.isoformat(),
            "recording": last.recording,
            "quantities": {
                n: {"value": float(v), "std": float(s), "unit": u, "visible_from": visible.get(n)}
                for (n, u), v, s in known
            },
            "misfit": float(self.history.misfit[-1]),
            "alarms": list(self.alarms),
            "budget": _budget(self.history),
            "change": change,
        }


def plan_of(robot: Robot, folder: str | Path) -> Plan:
    """The plan of a history; chosen and written where there is none.

    Raises:
        PlanError: the robot has no model, or the plan is damaged.
        HistoryError: the plan is of another robot.
    """
    path = Path(folder) / PLAN
    if not path.exists():
        choose(robot).write(path)
    plan = Plan.read(path)
    if plan.robot != robot.name:
        raise HistoryError(
            f"{path}: is of robot {plan.robot!r}, not {robot.name!r}: give each robot a folder of "
            "its own"
        )
    return plan


def choose(robot: Robot) -> Plan:
    """The poses of a robot's checks: informative ones that touch nothing, on a short way from home.

    The information on the typical changes of numbers and joints, beside their sizes as a prior, is
    largest (Bayesian D-optimality: Chaloner & Verdinelli 1995, doi 10.1214/ss/1177009939).

    Raises:
        PlanError: the robot has no model, or too few free poses.
    """
    if not isinstance(robot, SimulatedRobot):
        raise PlanError(f"robot {robot.name!r} has no model to plan with, and a check needs one")
    joints = ("joint.offset", "joint.compliance")
    wanted = {**FITTED, **{n: [p.name for p in effects()[n].parameters(robot)] for n in joints}}
    q, gravity, clearance = robot.pool(_POOL, 0), np.asarray(robot.gravity), Clearance(robot)
    scene = Scene(
        robot, robot.parameters.nominal, gravity, q, np.arange(_POOL) * 1.0,
        np.ones(_POOL, dtype=bool),
    )  # fmt: skip
    noise = registry.load("sensors", robot.sensor).noise.row_std / np.sqrt(SAMPLES)
    blocks = tangents(scene, wanted)[0] / noise[:, None]
    hits = [0]
    while hits:
        prior = np.eye(blocks.shape[-1])
        chosen = exchange(Pool(blocks), INDICES["O1"], _POSES - 1, prior=prior).chosen
        hits = [k for k in chosen if clearance.hit(q[k])]
        poses = list(q[chosen])
        q, blocks = np.delete(q, hits, axis=0), np.delete(blocks, hits, axis=0)
    way, here = [], np.asarray(robot.home, dtype=float)
    while poses:
        nearest = int(np.argmin([duration(robot, here, q) for q in poses]))
        here = poses.pop(nearest)
        way.append(here)
    return Plan.of(robot.name, np.array([*way, way[0]]))


def judge(robot: Robot, checks: Sequence[Check]) -> Judgement:
    """Judge the last check of a history.

    Raises:
        CalibrationError: the load of the first check since the baseline cannot be identified.
    """
    start = max(k for k, c in enumerate(checks) if k == 0 or c.baseline)
    stretch = History(robot, checks[start:])
    count, first = len(checks) - start, checks[start]
    alarms = _alarms(stretch)
    if alarms or any(c.verdict == CHANGED for c in checks[start:-1]):
        return _changed(stretch, alarms)
    if count < LEAST:
        headline = (
            f"cannot tell yet: check {count} since {first.baseline or 'the first check'}. {LEAST} "
            "checks are needed to know the ordinary scatter; a large change would have been found "
            "from the second on"
        )
        return Judgement(CANNOT_TELL, headline, stretch)
    visible = _visible(stretch)
    sizes = [f"{n} by {rough(n, visible[n], NUMBERS[n])}" for n in _EXAMPLES]
    headline = (
        f"healthy: no change in {count} checks since {first.time:%Y-%m-%d}. The next check finds "
        f"half of all steps of {', '.join(sizes[:-1])} or {sizes[-1]}"
    )
    return Judgement(HEALTHY, headline, stretch)


def _budget(stretch: History) -> float:
    """Probability of a false alarm that the last check may spend."""
    years = stretch.years
    return 0.0 if len(years) < 2 else ALARMS_A_YEAR * float(min(years[-1] - years[-2], 1.0))


def _alarms(stretch: History) -> tuple[str, ...]:
    """Names of what the last check found changed."""
    n, budget, names = len(stretch.years), _budget(stretch), []
    for count, fraction in SINCE.items():
        if count < n:
            step = stretch.step(n - count)
            level = budget * fraction
            names += [
                c.name for c in _compared(stretch, n - count, step, 0.75 * level) if c.changed
            ]
            names += [MISFIT] * (step.misfit < 0.25 * level)
    return tuple(dict.fromkeys(names))


def _compared(stretch: History, begin: int, step: Step, level: float) -> tuple[Change, ...]:
    before = stretch.values[:begin].mean(axis=0)
    return changes_of(
        NUMBERS, before, before + step.size, step.std, level=level, freedom=step.freedom
    )


def _visible(stretch: History) -> dict[str, float]:
    """Smallest step of each number that the next check would show with 50 %; none at first."""
    n = len(stretch.years)
    if n < 2:
        return {}
    step = stretch.step(n - 1)
    level = 0.75 * SINCE[1] * _budget(stretch) / len(NUMBERS)
    sizes = stats.t.isf(level / 2.0, step.freedom) * step.std
    return dict(zip(NUMBERS, sizes.tolist(), strict=True))


def _changed(stretch: History, alarms: tuple[str, ...]) -> Judgement:
    """Where the evidence of a step is largest, and what it moved."""
    steps = {k: stretch.step(k) for k in range(1, len(stretch.years))}
    evidence = np.array([s.evidence for s in steps.values()])
    begin = 1 + int(np.argmax(evidence))
    likely = 1 + np.flatnonzero(evidence > evidence.max() - _UNLIKELY)
    step, checks = steps[begin], stretch.checks
    changes = _compared(stretch, begin, step, LEVEL)
    moved = sorted((c for c in changes if c.changed), key=lambda c: -abs(c.sigmas))
    misfit = step.misfit < LEVEL
    texts = [c.sentence for c in moved]
    if misfit or not moved:
        texts.append(
            f"what these numbers do not explain (p {p_value(step.misfit)}): a joint, a cable or a "
            "contact may have changed, see `wrenchbed diagnose`"
        )
    headline = (
        f"changed between {checks[begin - 1].time:%Y-%m-%d} and {checks[begin].time:%Y-%m-%d}: "
        + "; ".join(texts)
    )
    if not alarms:
        headline += "; found at an earlier check"
    within = (int(likely[0]), int(likely[-1]))
    return Judgement(CHANGED, headline, stretch, alarms, begin, within, changes, misfit)


def stated(recording: Recording, given: Mapping[str, Any]) -> Recording:
    """A recording that keeps what a check states of it: time, temperature, baseline."""
    known = dict(recording.metadata.extra.get(_STATED) or {})
    extra = {**recording.metadata.extra, _STATED: {**known, **given}}
    return replace(recording, metadata=replace(recording.metadata, extra=extra))


def time_of(recording: Recording) -> datetime | None:
    """When a recording was made, as far as it states it.

    Raises:
        HistoryError: it states no time of ISO 8601 with a zone.
    """
    extra = recording.metadata.extra
    text = (extra.get(_STATED) or {}).get("time") or extra.get("started")
    return None if text is None else parse_time(str(text), recording.name)


def parse_time(text: str, where: str) -> datetime:
    """A time of ISO 8601, as UTC.

    Raises:
        HistoryError: it is none, or has no zone.
    """
    try:
        time = datetime.fromisoformat(text)
    except ValueError:
        time = datetime.min
    if time.tzinfo is None:
        raise HistoryError(
            f"{where}: {text!r} is no time with a zone: give it as 2026-11-23T06:00:00Z"
        )
    return time.astimezone(UTC)


def taken(recording: Recording, robot: Robot, plan: Plan) -> Check:
    """A recording that states its time as a check.

    Raises:
        HistoryError: it states no time.
        RecordingError: another robot, a motion, or other poses than the plan's; names the first.
    """
    time, metadata = time_of(recording), recording.metadata
    if time is None:
        raise HistoryError(f"{recording.name}: states no time; give --time 2026-11-23T06:00:00Z")
    if metadata.robot != robot.name or metadata.mode != "static" or not recording.joints:
        raise RecordingError(
            f"{recording.name}: is of {metadata.robot} ({metadata.mode}); a check needs "
            f"{robot.name} at rest in the poses of {plan.name}"
        )
    data, poses = observe(restored(recording)), len(plan)
    q = np.asarray(data.q)
    fits = len(q) >= poses and np.abs(q[:poses] - plan.q).max(axis=1) <= _FAR
    if not np.all(fits):
        first = len(q) if len(q) < poses else int(np.argmin(fits))
        raise RecordingError(
            f"{recording.name}: holds {len(q)} poses; pose {first} is not that of {plan.name}: "
            f"record that plan (wrenchbed record --plan {plan.name})"
        )
    said = metadata.extra.get(_STATED) or {}
    warm = recording.columns.get("temperature")
    temperature = said.get("temperature", np.nan) if warm is None else np.mean(warm)
    sensor = metadata.sensor.model or robot.sensor
    return Check(
        time=time, robot=robot.name, sensor=sensor, robot_digest=digest(robot, sensor),
        recording=file_of(time), recording_digest=digest_of(recording.wrench, recording.t),
        temperature=float(temperature), t=data.t[:poses], q=q[:poses], wrench=data.wrench[:poses],
        count=data.count[:poses].astype(float), covariance=data.row_covariance,
        baseline=str(said.get("baseline", "")),
    )  # fmt: skip


def check(
    robot: Robot,
    folder: str | Path,
    recording: Recording,
    *,
    time: datetime | None = None,
    temperature: float | None = None,
    baseline: str | None = None,
) -> Judgement:
    """Check a recording of a robot's plan against its history, which then holds it.

    Args:
        robot: whose history it is.
        folder: of the history; see `plan_of` for the plan in it.
        recording: of that plan.
        time: when it was made; what the recording states if None.
        temperature: of sensor or room [°C], where the recording has no column of it.
        baseline: why the robot differs from here on.

    Raises:
        HistoryError: the history is damaged, or this check does not continue it.
        RecordingError: it is of another robot, or of other poses than the plan's.
        CalibrationError: the load of the first check cannot be identified.
    """
    given = {
        "time": None if time is None else time.isoformat(timespec="milliseconds"),
        "temperature": temperature, "baseline": baseline,
    }  # fmt: skip
    known = stated(recording, {k: v for k, v in given.items() if v is not None})
    folder, now = Path(folder), datetime.now(UTC)
    checks = history.read(folder)
    new = taken(known, robot, plan_of(robot, folder))
    judgement, done = _judged(robot, folder, checks, new, now)
    known.write(folder / new.recording)
    history.write(folder, [*checks, done])
    return judgement


def _judged(
    robot: Robot, folder: Path, checks: Sequence[Check], new: Check, now: datetime
) -> tuple[Judgement, Check]:
    """What a new check shows, and the check with it.

    Raises:
        HistoryError: it does not continue the history, see `history.agrees`.
    """
    history.agrees(folder, checks, new, now)
    judgement = judge(robot, [*checks, new])
    numbers, values = judgement.history, {}
    for name, value, std in zip(NUMBERS, numbers.values[-1], numbers.std, strict=True):
        values |= {name: float(value), f"{name}.std": float(std)}
    values["misfit"] = float(numbers.misfit[-1])
    return judgement, replace(new, verdict=judgement.verdict, values=values)


def file_of(time: datetime) -> str:
    """Name of the recording of a check, `RECORDINGS` before it."""
    return f"{RECORDINGS}/{time:%Y%m%dT%H%M%SZ}.parquet"


def rebuild(robot: Robot, folder: Path, now: datetime) -> Judgement:
    """Make a history again from the recordings beside it; those that do not fit are named.

    Raises:
        HistoryError: no recording fits.
    """
    plan = plan_of(robot, folder)
    checks: list[Check] = []
    for path in sorted((folder / RECORDINGS).glob("*.parquet")):
        try:
            judgement, done = _judged(
                robot, folder, checks, taken(Recording.read(path), robot, plan), now
            )
        except WrenchbedError as error:
            warnings.warn(f"{path}: left out: {error}", WrenchbedWarning, stacklevel=2)
            continue
        checks.append(done)
    if not checks:
        raise HistoryError(f"{folder / RECORDINGS}: no recording of {robot.name} fits the plan")
    history.write(folder, checks)
    return judgement
