"""The monthly check of one robot: a recording of a few poses, compared with all earlier ones.

The last 1, 2, 4 and 8 checks are compared with those before them, by the rules of `compare`, with
the σ of the scatter from check to check (`steps`). False alarms are budgeted over time:
`ALARMS_A_YEAR` is spent in proportion to the time since the check before.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import Recording
from wrenchbed.effects.chain import effects
from wrenchbed.effects.scene import Scene
from wrenchbed.errors import HistoryError, PlanError
from wrenchbed.monitoring import history
from wrenchbed.monitoring.compare import LEVEL, Change, Comparison, changes_of, largest, significant
from wrenchbed.monitoring.history import Check
from wrenchbed.monitoring.steps import FITTED, History, tangents
from wrenchbed.pages import ReportPage
from wrenchbed.pages.document import provenance
from wrenchbed.pages.numbers import p_value
from wrenchbed.planning.collisions import Clearance
from wrenchbed.planning.criteria import INDICES
from wrenchbed.planning.exchange import Pool, exchange
from wrenchbed.robots.base import Robot, SimulatedRobot
from wrenchbed.robots.checked_moves import duration

PLAN = "plan.parquet"
"""Name of the plan's file in a history's folder."""
HEALTHY, CHANGED, CANNOT_TELL = "healthy", "changed", "cannot tell"
ALARMS_A_YEAR = 0.01
"""Probability of a false alarm in a year of checks of a healthy robot."""
SINCE = {1: 0.5, 2: 0.25, 4: 0.125, 8: 0.125}
"""Number of checks since a change → fraction of the false-alarm budget for changes of that age."""
MISFIT, _OF_MISFIT = "misfit", 0.25
"""Name of the fit's residual among the numbers, and fraction of the budget that is spent on it."""
LEAST = 4
"""Least checks since the last baseline to call a robot healthy: three show the ordinary scatter,
with the sensor's data."""
SAMPLES, RATE_HZ = 200, 100.0
"""Rows a pose and their rate [Hz]: a longer mean than 2 s gains little, by 1/f noise."""
_POSES, _POOL = 12, 2000
"""Poses of a check, of which the last is the first again, and number of candidate poses."""


@dataclass(frozen=True)
class Judgement:
    """Result of judging the last check of a robot's history.

    Attributes:
        verdict: `HEALTHY`, `CHANGED` or `CANNOT_TELL`.
        comparison: of the checks after a change with those before it; if nothing changed, of the
            last check with all before it. Its first sentence is the summary.
        history: checks since the last baseline.
        checks: all checks, each with its verdict and its numbers.
        begin: index of the first check after the change, or of the last check.
        alarms: names of numbers, or `MISFIT`, that changed according to the last check.
    """

    verdict: str
    comparison: Comparison
    history: History
    checks: Sequence[Check]
    begin: int
    alarms: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Convert to a JSON object: the comparison's fields, and verdict, alarms and numbers."""
        checks = self.history.checks
        return {
            "format": 2,
            "verdict": self.verdict,
            "robot": checks[-1].robot,
            "recording": checks[-1].recording,
            "since": checks[0].time.isoformat(),
            "after": checks[self.begin - 1].time.isoformat() if self.begin else None,
            "before": checks[self.begin].time.isoformat(),
            "alarms": list(self.alarms),
            "budget": _budget(self.history),
            "misfit": float(self.history.misfit[-1]),
            **self.comparison.to_json(),
        }

    def page(self, folder: str | Path, command: str = "") -> ReportPage:
        """HTML page of the last check in the history of ``folder``; it prints ``command``."""
        latest = Path(folder) / self.checks[-1].recording
        more = {"word": self.verdict, "latest": latest, "data": provenance([latest])}
        return self.comparison.page(command, checks=self.checks, **more)


def plan_of(robot: Robot, folder: str | Path) -> Plan:
    """Read the plan of checks in a history's folder; if there is none, choose poses and write it. A
    `PlanError` if the robot has no model or the plan is damaged, a `HistoryError` if it is of
    another robot."""
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
    """Choose the poses at which a robot is checked: informative, free of contact, near home.

    They maximise the information on typical changes of numbers and joints, with their sizes as
    prior (Bayesian D-optimality: Chaloner & Verdinelli 1995, doi 10.1214/ss/1177009939). A
    `PlanError` if the robot has no model, or too few free poses.
    """
    if not isinstance(robot, SimulatedRobot):
        raise PlanError(f"robot {robot.name!r} has no model to plan with, and a check needs one")
    wanted = [number[:2] for number in FITTED.values()]
    for joint in ("joint.offset", "joint.compliance"):
        wanted += [(joint, p.name) for p in effects()[joint].parameters(robot)]
    q, theta, gravity = robot.pool(_POOL, 0), robot.parameters.nominal, np.asarray(robot.gravity)
    scene = Scene(robot, theta, gravity, q, np.arange(_POOL) * 1.0, np.ones(_POOL, dtype=bool))
    noise = registry.load("sensors", robot.sensor).noise.row_std / np.sqrt(SAMPLES)
    blocks = tangents(scene, wanted)[0] / noise[:, None]
    prior, clearance, hits = np.eye(blocks.shape[-1]), Clearance(robot), [0]
    while hits:
        chosen = exchange(Pool(blocks), INDICES["O1"], _POSES - 1, prior=prior).chosen
        hits = [k for k in chosen if clearance.hit(q[k])]
        poses = list(q[chosen])
        q, blocks = np.delete(q, hits, axis=0), np.delete(blocks, hits, axis=0)
    way = [np.asarray(robot.home, dtype=float)]
    while poses:
        way.append(poses.pop(int(np.argmin([duration(robot, way[-1], q) for q in poses]))))
    return Plan.of(robot.name, np.array([*way[1:], way[1]]))


def judge(robot: Robot, checks: Sequence[Check]) -> Judgement:
    """Judge every check against the earlier ones since its baseline, and say what the last one
    shows; a `CalibrationError` if the load of a first check cannot be identified."""
    judged, start, changed = list[Check](), 0, False
    for k, check in enumerate(checks):
        if check.baseline:
            start, changed = k, False
        series = History(robot, checks[start : k + 1])
        alarms = _alarms(series)
        changed = changed or bool(alarms)  # until a new baseline
        verdict = CHANGED if changed else CANNOT_TELL if k + 1 - start < LEAST else HEALTHY
        numbers = zip(FITTED, series.values[-1].tolist(), series.std.tolist(), strict=True)
        values = {n: v for name, x, std in numbers for n, v in ((name, x), (f"{name}.std", std))}
        values[MISFIT] = float(series.misfit[-1])
        judged.append(replace(check, verdict=verdict, values=values))
    n, first, level = len(checks) - start, checks[start], _level(1, series)
    begin = n - 1
    if changed:
        level, begin = LEVEL, 1 + int(np.argmax([series.step(k).evidence for k in range(1, n)]))
    changes = _changes(series, begin, level) if begin else ()
    if changed:
        headline = _what_changed(series, begin, changes)
        headline += "" if alarms else "; found at an earlier check"
    elif verdict == CANNOT_TELL:
        headline = (
            f"cannot tell yet: check {n} since {first.baseline or 'the first check'}. {LEAST} "
            "checks are needed to know the ordinary scatter; a large change would have been found "
            "from the second on"
        )
    else:
        headline = f"healthy: no change in {n} checks since {first.time:%Y-%m-%d}"
    ends = f"{begin} checks from {first.day}", f"{n - begin} checks to {checks[-1].day}"
    decides = largest(changes, level, series.step(begin).freedom) if begin else ("", "")
    if changed and not any(c.changed for c in changes):
        p = p_value(series.step(begin).misfit)
        decides = f"p {p}", f"What these numbers do not explain; it counts below p {LEVEL:g}."
    comparison = Comparison("checks", *ends, changes, None, (), (headline,), changed, decides)
    return Judgement(verdict, comparison, series, judged, begin, alarms)


def _budget(series: History) -> float:
    """Probability of a false alarm allowed in the last check, by the time since the one before."""
    years = series.years
    return 0.0 if len(years) < 2 else ALARMS_A_YEAR * float(min(years[-1] - years[-2], 1.0))


def _level(count: int, series: History, share: float = 1.0 - _OF_MISFIT) -> float:
    """Probability of a false alarm allowed for a change ``count`` (1, 2, 4, 8) checks ago, of which
    ``share`` is spent on the numbers, or on the misfit."""
    return share * SINCE[count] * _budget(series)


def _alarms(series: History) -> tuple[str, ...]:
    """Names of the numbers that have changed according to the last check."""
    n, names = len(series.checks), list[str]()
    for count in (c for c in SINCE if c < n):
        changes = _changes(series, n - count, _level(count, series))
        names += [c.name for c in changes if c.changed]
        names += [MISFIT] * (series.step(n - count).misfit < _level(count, series, _OF_MISFIT))
    return tuple(dict.fromkeys(names))


def _changes(series: History, begin: int, level: float) -> tuple[Change, ...]:
    """Change of each number from the checks before index ``begin`` to those since, significant at
    ``level`` (probability of any false alarm)."""
    step, before = series.step(begin), series.values[:begin].mean(axis=0)
    units, after = {name: unit for name, (*_, unit) in FITTED.items()}, before + step.size
    return changes_of(units, before, after, step.std, level=level, freedom=step.freedom)


def _what_changed(series: History, begin: int, changes: Sequence[Change]) -> str:
    """Sentence on when a change began (index ``begin``) and which numbers changed."""
    texts, p = significant(changes), series.step(begin).misfit
    if p < LEVEL or not texts:
        texts.append(
            f"what these numbers do not explain (p {p_value(p)}): a joint, a cable or a contact "
            "may have changed, see `wrenchbed diagnose`"
        )
    before, after = (series.checks[k].time for k in (begin - 1, begin))
    return f"changed between {before:%Y-%m-%d} and {after:%Y-%m-%d}: {'; '.join(texts)}"


def check(
    robot: Robot,
    folder: str | Path,
    recording: Recording,
    *,
    time: datetime | None = None,
    temperature: float | None = None,
    baseline: str | None = None,
) -> Judgement:
    """Judge a recording of a robot's plan against its history, and add it to the history.

    Args:
        folder: folder of the history; `plan_of` reads the plan in it.
        time: when the recording was made; if None, the time that its metadata state.
        temperature: of sensor or room [°C], if the recording has no column of it.
        baseline: reason why history begins anew with this check; None if it does not.

    Raises:
        HistoryError: this check does not continue the history.
        RecordingError: it is of another robot, or of other poses than the plan's.
        CalibrationError: the load of the first check cannot be identified.
    """
    time = time or history.time_of(recording)
    given: dict[str, Any] = {"time": time.isoformat(timespec="milliseconds")}
    given |= {} if temperature is None else {"temperature": temperature}
    given |= {} if baseline is None else {"baseline": baseline}
    known, folder = history.stated(recording, given), Path(folder)
    plan = plan_of(robot, folder)
    checks, new = history.read(folder, robot, plan), history.taken(known, robot, plan)
    history.continues(checks, new, f"{recording.name}: ")
    history.in_time(checks, new.time, datetime.now(UTC))
    judgement = judge(robot, [*checks, new])
    known.write(folder / new.recording)
    history.write(folder, judgement.checks)
    return judgement
