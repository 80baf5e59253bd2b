"""Gains, friction and delay of position servos, fitted to commanded and reached joint values.

M q̈ + C + g = kp (u(t − T) − q) − kv q̇ − friction: rigid-body torque on the left, u the target, T
the delay. So the tracking error is the effort of a drive whose constant is kp, as `identify` fits
it to currents; T is one more column, linear near its value. Only the sum of kv and viscous friction
is identifiable. Pieces between gaps and episodes are filtered apart.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy  # which loads its slow submodules when they are first used

from wrenchbed.calibration.fit import IdentifiedValue, identified_values
from wrenchbed.channels.command import CHANNEL
from wrenchbed.data.recording import Recording
from wrenchbed.drives.effort_fit import COMMAND_FIT, DriveFit
from wrenchbed.drives.identify import (
    FRICTION,
    WIDE,
    arm_of,
    by_ordinary_errors,
    check_moves,
    errors_of,
    jackknife,
    problem_of,
    published,
    refutation,
    values_of,
)
from wrenchbed.drives.identify_at_rest import CONSTANT
from wrenchbed.drives.joint_least_squares import Problem, Solution, moved_by, parts, solve
from wrenchbed.drives.signals import DriveSignals, encoder_noise, motion_signals, signals_of_pieces
from wrenchbed.errors import CalibrationError, ParameterError
from wrenchbed.robots.base import Joint

STIFFNESS, DELAY, SETPOINT = "servo.stiffness", "servo.delay", "servo.setpoint"
"""Parameters of a servo; `SETPOINT` is tracking error over v |v|, v the target's speed: setpoints
of limited speed trail by the square of the speed, and friction falls with it; without it both pass
for Coulomb friction and delay."""
SERVO, TOOL = "servo", "tool"
"""Groups that may be free: the servos always are; of the load mass, centre and inertia."""
LATEST = 0.3
"""Longest delay that is sought [s]: that of a policy or a network."""
_PER_ROW = 4.0
"""Delays that the first search tries per time of a row."""
_STEPS, _CLOSE = 20, 1e-5
"""Steps towards the delays at most, and the change [s] that ends them."""
_REST = 0.25
"""Share of the correction for encoders' noise that may be wrong: of counts of 1.5, 3 and 6 mrad it
left 0.2 to 0.4 of what they moved damping and inertia by (`tests/drives/test_servos.py`)."""
_NOTHING = 1e-6
"""Largest tracking error [rad or m] that is none: an echo of the command."""


@dataclass(frozen=True, eq=False)
class Piece:
    """Consecutive rows of a motion, with its commands.

    Attributes:
        signals: the motion; its ``effort`` holds the joint values as read [rad or m].
        target: antiderivative in time of each joint's target, a function of times [s].
    """

    signals: DriveSignals
    target: tuple[Callable[[np.ndarray], np.ndarray], ...]

    def noise(self, rng: np.random.Generator) -> np.ndarray:
        """Draw noise (N, J) [rad or m] as strong as encoder noise that the joint values show."""
        std = [encoder_noise(x, self.signals.rate) for x in self.signals.effort.T]
        return rng.normal(size=self.signals.effort.shape) * std

    def shaken(self, noise: np.ndarray) -> "Piece":
        """Copy of the piece with added noise (N, J) on its joint values."""
        s, q = self.signals, self.signals.effort + noise
        return replace(self, signals=motion_signals("", s.t, q, q, s.cutoff, s.edges))

    def error(self, delay: np.ndarray) -> np.ndarray:
        """Filtered tracking error (M, J), M kept rows, of targets delayed by ``delay`` (J,) [s]."""
        return self.signals.filtered(self.held(delay) - self.signals.effort)

    def by_speed(self, delay: np.ndarray) -> np.ndarray:
        """Filtered columns (M, J, 2), M kept rows: speed v |v| of the delayed targets, then v."""
        speed = self.speed(delay)
        return self.signals.filtered(np.stack([speed * np.abs(speed), speed], axis=2))

    def speed(self, delay: np.ndarray) -> np.ndarray:
        """Speed (N, J) of the targets, delayed by ``delay`` (J,) [s]."""
        step = 0.5 / self.signals.rate
        return (self.held(delay - step) - self.held(delay + step)) / (2.0 * step)

    def held(self, delay: np.ndarray) -> np.ndarray:
        """Targets (N, J), delayed by ``delay`` (J,) [s]: means of a spline over each row's time."""
        t, period = self.signals.t, 1.0 / self.signals.rate
        each = zip(self.target, delay.tolist(), strict=True)
        means = [(s(t - d) - s(t - d - period)) / period for s, d in each]
        return np.stack(means, axis=1)


def calibrate_servos(
    recording: Recording, free: Sequence[str] = (), *, force: bool = False
) -> DriveFit:
    """Fit the position servos of an arm to commanded and reached joint values of a motion.

    Args:
        recording: with ``q_target1…`` beside ``q1…``; ``segment`` or gaps of the clock separate its
            pieces.
        free: of ``servo`` and ``tool``; the servos are always free, the load if ``free`` is empty.
        force: return values that the data refute, instead of raising.

    Raises:
        RecordingError, CalibrationError: the recording cannot be fitted, or refutes the fit.
        ParameterError: ``free`` has a name that is no group.
        NotFoundError: the robot's model has no joint torques.
    """
    if unknown := [name for name in free if name not in (SERVO, TOOL)]:
        raise ParameterError(f"--free {unknown[0]}: of commands {SERVO} and {TOOL} can be freed")
    pieces = pieces_of(recording)
    groups = (*FRICTION, CONSTANT, *(() if free and TOOL not in free else (TOOL,)))
    problem, starts = problem_of(recording, [p.signals for p in pieces], groups)
    check_moves(recording.name, problem)
    about, solution, delay = _iterated(problem, pieces)
    noise = [p.noise(np.random.default_rng(k)) for k, p in enumerate(pieces)]

    def with_more(size: float) -> Solution:
        shaken = [p.shaken(size * n) for p, n in zip(pieces, noise, strict=True)]
        problem, _ = problem_of(recording, [p.signals for p in shaken], groups)
        return solve(_linearised(problem, shaken, delay))

    once, twice = ([with_more(s), with_more(-s)] for s in (1.0, float(np.sqrt(2.0))))
    better = _extrapolated(solution, once, twice)
    doubt = _REST * (better.x - solution.x)
    fit = _fit(recording, pieces, about, better, doubt, delay, starts)
    if fit.refuted is not None and not force:
        raise CalibrationError(
            f"{recording.name}: {fit.refuted}; --force gives the values all the same"
        )
    return fit


def _extrapolated(
    solution: Solution, once: Sequence[Solution], twice: Sequence[Solution]
) -> Solution:
    """Solution without the bias by encoder noise, extrapolated from fits with that noise added once
    and twice (SIMEX: Cook & Stefanski 1994, doi 10.1080/01621459.1994.10476871)."""

    def without(name: str) -> np.ndarray:
        one, two = (np.mean([getattr(s, name) for s in some], axis=0) for some in (once, twice))
        return np.asarray(3.0 * (getattr(solution, name) - one) + two)

    return replace(solution, x=without("x"), folds=without("folds"))


def pieces_of(recording: Recording) -> list[Piece]:
    """Split a motion at gaps of its clock and between its segments.

    Raises:
        CalibrationError: no targets, targets that equal the joint values, or pieces too short.
    """
    name, t, q = recording.name, recording.t, recording.q
    channel = CHANNEL.of(recording)
    if missing := [c for c in channel.columns if c not in recording.columns]:
        raise CalibrationError(
            f"{name}: no column {missing[0]}: a fit of servos needs what was commanded, "
            "q_target1…, beside what was reached, q1…"
        )
    if recording.metadata.mode != "dynamic":
        raise CalibrationError(f"{name}: servos at rest do not tell their gains: record a motion")
    target = np.stack([recording.columns[c] for c in channel.columns], axis=-1)
    if np.abs(target - q).max() < _NOTHING:
        raise CalibrationError(
            f"{name}: q_target1… are q1…: the targets only echo what was reached"
        )
    signals = signals_of_pieces(recording, q)
    return [_piece(s, target[np.searchsorted(t, s.t)]) for s in signals]


def _piece(signals: DriveSignals, target: np.ndarray) -> Piece:
    t = signals.t
    period = 1.0 / signals.rate
    before = int(LATEST / period) + 3  # rows for which the first target stood
    rows = np.arange(-before, len(t) + 3)
    course = target[np.clip(rows, 0, len(t) - 1)]
    splines = [scipy.interpolate.make_interp_spline(t[0] + rows * period, x, k=3) for x in course.T]
    return Piece(signals, tuple(spline.antiderivative() for spline in splines))


def _iterated(problem: Problem, pieces: Sequence[Piece]) -> tuple[Problem, Solution, np.ndarray]:
    """Iterate the delays: return last linearised problem, its solution, the delays (J,) [s]."""
    delay, most = _first_delays(problem, pieces), 1.0 / pieces[0].signals.rate
    for _ in range(_STEPS):
        about = _linearised(problem, pieces, delay)
        solution = solve(about)
        change = parts(about, solution.x)[2][:, -1]
        if np.abs(change).max() < _CLOSE:
            break
        delay = np.clip(delay + np.clip(change, -most, most), -most, LATEST)
    return about, solution, delay


def _linearised(problem: Problem, pieces: Sequence[Piece], delay: np.ndarray) -> Problem:
    """Problem linearised about delays (J,) [s]: tracking errors, and after other columns of each
    joint two more: by the square of its target's speed, and by its delay."""
    y = np.concatenate([p.error(delay) for p in pieces])
    more = np.concatenate([p.by_speed(delay) for p in pieces])
    own = np.concatenate([problem.own, more], axis=2)
    return replace(problem, y=y, own=own, kinds=(*problem.kinds, SETPOINT, DELAY))


def _first_delays(problem: Problem, pieces: Sequence[Piece]) -> np.ndarray:
    """Initial delays (J,) [s]: those of a grid at which each joint alone fits best."""
    period, joints = 1.0 / pieces[0].signals.rate, problem.y.shape[1]
    grid = np.arange(-period, LATEST, period / _PER_ROW)
    errors = np.stack([
        np.concatenate([p.error(np.full(joints, d)) for p in pieces]) for d in grid
    ])  # fmt: skip
    best = []
    for j in range(joints):
        use = problem.use[:, j]
        columns = np.column_stack([problem.nominal[use, j], problem.own[use, j]])
        basis = np.linalg.qr(columns)[0]
        y = errors[:, use, j]
        best.append(grid[np.argmin((y**2).sum(axis=1) - ((y @ basis) ** 2).sum(axis=1))])
    return np.array(best)


def _fit(
    recording: Recording, pieces: Sequence[Piece], problem: Problem, solution: Solution,
    doubt: np.ndarray, delay: np.ndarray, starts: dict[str, float],
) -> DriveFit:  # fmt: skip
    joints = arm_of(recording).joints
    more = parts(problem, np.arange(len(solution.x)))[2][:, -2:].ravel()
    drive = replace(problem, own=problem.own[:, :, :-2], kinds=problem.kinds[:-2])
    of_drive = Solution(
        np.delete(solution.x, more), np.delete(solution.folds, more, axis=1),
        np.delete(solution.determined, more), solution.weight,
    )  # fmt: skip

    def of_commands(x: np.ndarray) -> np.ndarray:
        setpoint, later = parts(problem, x)[2][:, -2:].T
        return np.concatenate([setpoint, delay + later])

    def all_published(x: np.ndarray) -> np.ndarray:
        return np.append(published(drive, np.delete(x, more), starts), of_commands(x))

    shift = all_published(solution.x + doubt) - all_published(solution.x)
    covariance = jackknife(np.array([all_published(x) for x in solution.folds]))
    covariance += np.outer(shift, shift)
    last = 2 * len(joints)
    values = values_of(drive, of_drive, starts, joints, covariance[:-last, :-last])
    std = np.sqrt(np.diagonal(covariance))[-last:]
    known = parts(problem, solution.determined)[2][:, -2:].T.ravel()
    identified = [_as_servo(p, joints) for p in values]
    names = [(f"{SETPOINT}.{j}", f"s²/{x.unit}") for j, x in enumerate(joints, start=1)]
    names += [(f"{DELAY}.{j}", "s") for j in range(1, len(joints) + 1)]
    identified += identified_values(
        names, of_commands(solution.x), std, np.zeros(last), known, WIDE
    )
    errors = errors_of(problem, solution, [joint.unit for joint in joints])
    signals, by_errors = [p.signals for p in pieces], None
    if problem.changes:
        torques = by_ordinary_errors(recording, signals, problem, solution)
        changed = [all_published(x) for x in moved_by(problem, solution, torques)]
        by_errors = np.array(changed) - all_published(solution.x)
    return DriveFit(
        recording.name, recording.metadata.robot, "rad", tuple(identified), errors, covariance,
        signals[0].cutoff, sum(float(s.t[-1] - s.t[0]) for s in signals),
        sum(len(s.t) for s in signals), refutation(errors, identified), channels=COMMAND_FIT,
        cannot_tell=_ratios(problem, solution, identified, joints), by_errors=by_errors,
    )  # fmt: skip


def _as_servo(p: IdentifiedValue, joints: Sequence[Joint]) -> IdentifiedValue:
    """Rename a drive constant to a servo stiffness, with its unit; other parameters stay."""
    kind, _, number = p.name.rpartition(".")
    if kind != CONSTANT:
        return p
    unit = joints[int(number) - 1].own("N·m/rad")
    return replace(p, name=f"{STIFFNESS}.{number}", unit=unit)


def _ratios(
    problem: Problem, solution: Solution, identified: Sequence[IdentifiedValue],
    joints: Sequence[Joint],
) -> tuple[str, ...]:  # fmt: skip
    """Sentences on friction and damping over stiffness, of joints whose stiffness is unknown."""
    determined = {p.name: p.std is not None for p in identified}
    numbers, folds = (parts(problem, x)[2] for x in (solution.x, solution.folds))
    sentences = []
    for j, joint in enumerate(joints):
        if determined[f"{STIFFNESS}.{j + 1}"]:
            continue
        size, std = numbers[j], np.sqrt(np.diagonal(jackknife(folds[:, j])))
        rub, drag = (f"{size[k]:.3g} ± {std[k]:.2g}" for k in (0, 1))
        sentences.append(
            f"joint {j + 1}: too little known weight loads it to tell its stiffness; friction over "
            f"stiffness is {rub} {joint.unit}, damping over stiffness {drag} s"
        )
    return tuple(sentences)
