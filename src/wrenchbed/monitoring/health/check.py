"""One check of a robot: its recording against the history, a verdict, and the history with it."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import Recording
from wrenchbed.errors import HistoryError, WrenchbedError, WrenchbedWarning
from wrenchbed.monitoring.health import history, poses
from wrenchbed.monitoring.health.causes import Cause, explain, named
from wrenchbed.monitoring.health.history import RECORDINGS, Check
from wrenchbed.monitoring.health.quantities import QUANTITIES, Basis, summary
from wrenchbed.monitoring.health.trends import Test, Trends, interval
from wrenchbed.pages.numbers import chance, rough
from wrenchbed.robots.base import Robot

PLAN = "plan.parquet"
"""Name of the plan in the folder of a history."""
HEALTHY, CHANGED, CANNOT_TELL = "healthy", "changed", "cannot tell"
LEAST = 4
"""Checks since the last baseline from which a robot may be called healthy: three show the ordinary
scatter, with the sensor's data; estimate."""
_STATED = "check"
"""Field of a recording's metadata with what a check states: time, temperature, baseline."""
_SURE = 0.01
"""Level of a list of quantities that a change moved, over all of them (Bonferroni)."""


@dataclass(frozen=True)
class Moved:
    """A quantity in a change.

    Attributes:
        name, unit: of the quantity.
        size, std: of its step [unit].
        interval95: of the step [unit].
        before: mean before the step [unit].
    """

    name: str
    unit: str
    size: float
    std: float
    interval95: tuple[float, float]
    before: float


@dataclass(frozen=True, eq=False)
class Judgement:
    """What a history says of its last check.

    Attributes:
        verdict: `HEALTHY`, `CHANGED` or `CANNOT_TELL`.
        headline: what a person should know first.
        trends: all series.
        tests: of the last check.
        begin: first check after a change; None without one.
        within: first and last check that may be that, 95 %.
        moved: quantities that changed, the surest first.
        causes: named together, the likeliest first; empty if unknown.
        chances: probability of each effect, and of ``unknown``.
    """

    verdict: str
    headline: str
    trends: Trends
    tests: tuple[Test, ...]
    begin: int | None = None
    within: tuple[int, int] | None = None
    moved: tuple[Moved, ...] = ()
    causes: tuple[Cause, ...] = ()
    chances: Mapping[str, float] | None = None

    @property
    def checks(self) -> Sequence[Check]:
        """The history."""
        return self.trends.basis.checks

    def to_json(self) -> dict[str, Any]:
        """As a JSON object."""
        t, basis, last = self.trends, self.trends.basis, len(self.checks) - 1
        slope, half = t.slopes()
        visible = t.visible()
        std = np.sqrt(np.diagonal(basis.covariance))
        numbers = {
            name: {
                "value": float(basis.values[last, j]),
                "std": float(std[j]),
                "unit": unit,
                "per_year": _finite(slope[j]),
                "per_year_interval95": [_finite(slope[j] - half[j]), _finite(slope[j] + half[j])],
                "visible_from": _finite(visible[j]),
            }
            for j, (name, unit) in enumerate(QUANTITIES.items())
        }
        return {
            "format": 1,
            "robot": basis.robot.name,
            "verdict": self.verdict,
            "headline": self.headline,
            "checks": last + 1,
            "since": self.checks[t.since].time.isoformat(),
            "time": self.checks[last].time.isoformat(),
            "recording": self.checks[last].recording,
            "temperature": _finite(self.checks[last].temperature),
            "quantities": numbers,
            "misfit": float(basis.misfit[last]),
            "alarms": [asdict(x) for x in self.tests if x.alarm],
            "budget": t.budget(),
            "change": self._change(),
        }

    def _change(self) -> dict[str, Any] | None:
        if self.begin is None or self.within is None:
            return None
        times = [c.time.isoformat() for c in self.checks]
        return {
            "after": times[self.begin - 1],
            "before": times[self.begin],
            "interval95": [times[self.within[0] - 1], times[self.within[1]]],
            "quantities": [asdict(m) for m in self.moved],
            "causes": [asdict(c) for c in self.causes],
            "probabilities": dict(self.chances or {}),
        }


def _finite(x: float) -> float | None:
    return float(x) if np.isfinite(x) else None


def plan_of(robot: Robot, folder: str | Path) -> Plan:
    """The plan of a history; chosen and written where there is none.

    Raises:
        PlanError: the robot has no joints, or the plan is damaged.
        HistoryError: the plan is of another robot.
    """
    path = Path(folder) / PLAN
    if not path.exists():
        poses.choose(robot).write(path)
    plan = Plan.read(path)
    if plan.robot != robot.name:
        raise HistoryError(
            f"{path}: is of robot {plan.robot!r}, not {robot.name!r}: give each robot a folder of "
            "its own"
        )
    return plan


def judge(robot: Robot, checks: Sequence[Check]) -> Judgement:
    """Judge the last check of a history.

    Raises:
        CalibrationError: the load of the first check cannot be identified.
    """
    starts = [k for k, c in enumerate(checks) if k == 0 or c.baseline]
    trends = Trends(Basis(robot, checks, starts[-1]))
    tests, since = tuple(trends.tests()), starts[-1]
    warned = any(c.verdict == CHANGED for c in checks[since:-1])
    if warned or any(t.alarm for t in tests):
        return _changed(trends, tests)
    count = len(checks) - since
    if count < LEAST:
        why = checks[since].baseline or "the first check"
        headline = (
            f"cannot tell yet: check {count} since {why}. {LEAST} checks are needed to know the "
            "ordinary scatter; a large change would have been found from the second on"
        )
        return Judgement(CANNOT_TELL, headline, trends, tests)
    headline = (
        f"healthy: no change in {count} checks since {checks[since].time:%Y-%m-%d}. The next check "
        f"finds half of all steps of {_visible(trends)}"
    )
    return Judgement(HEALTHY, headline, trends, tests)


_EXAMPLES = ("sensor.bias.fz", "tool.mass", "base.tilt.x")
"""Quantities whose smallest visible step a headline states."""


def _visible(trends: Trends) -> str:
    sizes = dict(zip(QUANTITIES, trends.visible().tolist(), strict=True))
    told = [f"{n} by {rough(n, sizes[n], QUANTITIES[n])}" for n in _EXAMPLES]
    return f"{', '.join(told[:-1])} or {told[-1]}"


def _changed(trends: Trends, tests: tuple[Test, ...]) -> Judgement:
    weights = trends.begins()
    begin = int(np.argmax(weights))
    within = interval(weights)
    causes, unknown = explain(trends, begin)
    told = tuple(named(causes, unknown))
    moved = _moved(trends, begin)
    checks = trends.basis.checks
    when = f"between {checks[begin - 1].time:%Y-%m-%d} and {checks[begin].time:%Y-%m-%d}"
    headline = f"changed {when}: {_why(told, unknown)}"
    if not any(t.alarm for t in tests):
        headline += "; found at an earlier check"
    chances = {c.effect: c.probability for c in causes if c.probability > _LEAST_CHANCE}
    return Judgement(CHANGED, headline, trends, tests, begin, within, moved, told,
                     chances | {"unknown": unknown})  # fmt: skip


_LEAST_CHANCE = 1e-3
"""Probability from which an effect is listed."""


def _why(causes: Sequence[Cause], unknown: float) -> str:
    if not causes:
        return f"the cause is unknown, no effect of the library explains it (p {chance(unknown)})"
    sizes = [f"{c.effect} ({c.sizes})" for c in causes]
    if len(causes) == 1:
        return f"{sizes[0]}, probability {chance(causes[0].probability)}"
    return f"{' or '.join(sizes)}; these poses cannot tell which"


def _moved(trends: Trends, begin: int) -> tuple[Moved, ...]:
    """Quantities that a change moved for sure, else the surest one."""
    found = []
    for j, (name, unit) in enumerate(QUANTITIES.items()):
        step = trends.step(begin, j)
        before = float(trends.basis.values[trends.since : begin, j].mean())
        found.append((step.p, Moved(name, unit, step.size, step.std, step.interval95, before)))
    found.sort(key=lambda x: x[0])
    return tuple(m for k, (p, m) in enumerate(found) if k == 0 or p < _SURE / len(QUANTITIES))


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
        RecordingError: it is of another robot, or of other poses than the plan's.
    """
    time = time_of(recording)
    if time is None:
        raise HistoryError(f"{recording.name}: states no time; give --time 2026-11-23T06:00:00Z")
    told = recording.metadata.extra.get(_STATED) or {}
    new = summary(recording, robot, plan, time)
    if np.isnan(new.temperature):
        new = replace(new, temperature=float(told.get("temperature", np.nan)))
    return replace(new, recording=file_of(time), baseline=str(told.get("baseline", "")))


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
    when = None if time is None else time.isoformat(timespec="milliseconds")
    told = {"time": when, "temperature": temperature, "baseline": baseline}
    given = stated(recording, {k: v for k, v in told.items() if v is not None})
    return add(robot, Path(folder), history.read(Path(folder)), given, datetime.now(UTC))


def add(
    robot: Robot, folder: Path, checks: Sequence[Check], recording: Recording, now: datetime
) -> Judgement:
    """Judge a recording of the plan; keep it, and write the history with it, each atomically.

    Args:
        folder: of the history.
        checks: as `history.read` gives them.
        recording: that states its time, see `stated`.
        now: this machine's clock.

    Raises:
        HistoryError: it does not continue the history, see `history.agrees`.
        RecordingError: it is of another robot, or of other poses than the plan's.
        CalibrationError: the load of the first check cannot be identified.
    """
    new = taken(recording, robot, plan_of(robot, folder))
    history.agrees(folder, checks, new, now)
    found, done = _judged(robot, checks, new)
    recording.write(folder / new.recording)
    history.write(folder, [*checks, done])
    return found


def _judged(robot: Robot, checks: Sequence[Check], new: Check) -> tuple[Judgement, Check]:
    """What a new check shows, and the check with it."""
    found = judge(robot, [*checks, new])
    values, correlated = found.trends.basis.identified(len(checks))
    return found, replace(new, verdict=found.verdict, values=values, correlated=correlated)


def file_of(time: datetime) -> str:
    """Name of the recording of a check, `RECORDINGS` before it."""
    return f"{RECORDINGS}/{time:%Y%m%dT%H%M%SZ}.parquet"


def rebuild(robot: Robot, folder: Path, now: datetime) -> Judgement:
    """Make a history again from the recordings beside it; those that do not fit are named.

    Raises:
        HistoryError: no recording fits.
    """
    plan = plan_of(robot, folder)
    found: list[Check] = []
    for path in sorted((folder / RECORDINGS).glob("*.parquet")):
        try:
            new = taken(Recording.read(path), robot, plan)
            history.agrees(folder, found, new, now)
            last, done = _judged(robot, found, new)
        except WrenchbedError as error:
            warnings.warn(f"{path}: left out: {error}", WrenchbedWarning, stacklevel=2)
            continue
        found.append(done)
    if not found:
        raise HistoryError(f"{folder / RECORDINGS}: no recording of {robot.name} fits the plan")
    history.write(folder, found)
    return last
