"""Friction, drive constants, payload and links of an arm, fitted to its joint torques or currents.

y = g (τ₀ + P δ) + F f, joint by joint: τ₀ the nominal rigid body's torque, P δ that of changes δ of
inertial parameters, F f that of friction, rotor and offset, g = 1/K of drive constants K where
currents are measured. Folds of time leave a block out each: their fits give the standard errors
(jackknife over blocks, Künsch 1989, doi 10.1214/aos/1176347265) and errors on rows that no fit saw.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import stdtrit  # scipy.stats takes a second to load

from wrenchbed.calibration.checks.mistakes import MENDED, TURNED, along_another_axis
from wrenchbed.calibration.fit import IdentifiedValue, identified_values
from wrenchbed.data.recording import EFFORT_UNITS, Recording
from wrenchbed.drives.base_parameters import BaseParameters
from wrenchbed.drives.effort_fit import DriveFit, JointError, impossible, joint_errors
from wrenchbed.drives.identify_at_rest import CONSTANT, calibrate_at_rest
from wrenchbed.drives.identify_at_rest import GROUPS as AT_REST
from wrenchbed.drives.joint_least_squares import (
    FOLDS,
    Problem,
    Solution,
    followed_gravity,
    moved_by,
    parts,
    residual,
    sizes_shown,
    solve,
    start,
)
from wrenchbed.drives.ordinary_errors import after_reversal, by_each, link_errors
from wrenchbed.drives.signals import DriveSignals, as_torques, efforts_of, signals_of_pieces
from wrenchbed.errors import CalibrationError, NotFoundError, ParameterError
from wrenchbed.physics.rigid_load_regressor import INERTIAL
from wrenchbed.physics.taylor_jets import Jet
from wrenchbed.physics.wrench import about_centre, of_mass, of_moment, six_of, symmetric
from wrenchbed.robots.base import INERTIA_AXES, Joint, SimulatedRobot
from wrenchbed.robots.inverse_dynamics import rotor_torque, torque_regressor
from wrenchbed.robots.mjspec_edits import LinkInertias, at_home, link_inertias
from wrenchbed.simulation.closed_form import Model, robot_of

FRICTION = ("drive.coulomb", "drive.viscous", "drive.offset", "drive.inertia")
GROUPS = (*FRICTION, CONSTANT, "tool", "link")
"""Groups that may be free; ``tool`` is mass and centre of gravity of the load, ``link`` all
inertial parameters that torques determine, the load's among them."""
_WORSE = 1.0
"""Error on held-out rows over the spread of the effort from which a fit explains nothing."""
LOAD = ("tool.mass", *(f"tool.moment.{a}" for a in "xyz"),
        *(f"tool.second.{a}" for a in INERTIA_AXES))  # fmt: skip
"""The ten inertial parameters of the load, about the sensor's origin in its axes."""
_LEVER, _POWER = 0.2, np.repeat([0, 1, 2], [1, 3, 6])
"""Prior of a load: as heavy as the arm, this far from the sensor (over the arm's reach), and the
distance's power in each of `LOAD`. Where the scale of currents is free nothing else bounds it."""
WIDE = float(stdtrit(FOLDS - 1, 0.975))
"""Half a 95 % interval in standard errors, with one degree of freedom less than folds."""
_COG = tuple(f"tool.cog.{a}" for a in "xyz")
_INERTIA = tuple(f"tool.inertia.{a}" for a in INERTIA_AXES)
_UNITS = {"drive.coulomb": "N·m", "drive.viscous": "N·m·s/rad", "drive.offset": "N·m",
          "drive.inertia": "kg·m²"}  # fmt: skip
_LINK_UNITS = {"m": "kg"} | {f"m{a}": "kg·m" for a in "xyz"}


def calibrate_efforts(
    recording: Recording,
    free: Sequence[str] = (),
    *,
    constants: Sequence[float] | None = None,
    force: bool = False,
) -> DriveFit:
    """Fit the joint torques ``tau1…`` or currents ``i1…`` of a motion, or of poses at rest.

    Args:
        free: names of `GROUPS`; by default friction, tool, and constants that nobody states.
        constants: known (J,) [N·m/A, of slides N/A], gear included: currents become torques.
        force: return values that held-out rows refute, instead of raising.

    Raises:
        RecordingError, CalibrationError: the recording cannot be fitted, or refutes the fit.
        ParameterError: ``free`` has a name that is no group.
        NotFoundError: the robot's model has no joint torques.
    """
    prefix, effort = efforts_of(recording)
    dead = np.flatnonzero(np.ptp(effort, axis=0) == 0.0)
    column = f"{prefix}{dead[0] + 1}" if dead.size else ""
    rest = recording.metadata.mode == "static"
    if constants is not None:
        effort, prefix = as_torques(effort, prefix, constants, recording.name), "tau"
    groups = _groups(free, prefix, stated=constants is not None, rest=rest)
    if rest:
        fit = calibrate_at_rest(recording, arm_of(recording), effort, prefix, groups)
    else:
        fit, other = _calibrate_in_motion(recording, effort, prefix, groups, column)
        stated = np.asarray(Model.of(arm_of(recording), recording.metadata).gravity)
        angle = float(np.arctan2(np.linalg.norm(np.cross(stated, other)), stated @ other))
        if angle > TURNED:
            gravity = tuple(other.tolist())
            turned = replace(recording, metadata=replace(recording.metadata, gravity=gravity))
            better, _ = _calibrate_in_motion(turned, effort, prefix, groups, column)
            if better.misfit < MENDED * fit.misfit:
                refuted = along_another_axis(other, angle, "efforts")
                fit = replace(fit, refuted=refuted, gravity=gravity)
    if constants is not None:
        fit = replace(fit, constants=tuple(map(float, constants)))
    if fit.refuted is not None and not force:
        raise CalibrationError(
            f"{recording.name}: {fit.refuted}; --force gives the values all the same"
        )
    return fit


def _calibrate_in_motion(
    recording: Recording, effort: np.ndarray, prefix: str, groups: tuple[str, ...], dead: str
) -> tuple[DriveFit, np.ndarray]:
    """Fit of a motion, and the gravity (3,) that its efforts follow, as large as the stated one."""
    signals = signals_of_pieces(recording, effort)
    problem, starts = problem_of(recording, signals, groups)
    check_moves(recording.name, problem)
    if dead:
        raise CalibrationError(f"{recording.name}: column {dead!r} never changes")
    solution, joints = solve(problem), arm_of(recording).joints
    covariance = jackknife(np.array([published(problem, x, starts) for x in solution.folds]))
    identified = values_of(problem, solution, starts, joints, covariance)
    errors = errors_of(problem, solution, [joint.own(EFFORT_UNITS[prefix]) for joint in joints])
    refuted, size, away = refutation(errors, identified), 0.0, None
    if problem.changes == LOAD:
        torques = by_ordinary_errors(recording, signals, problem, solution)
        moved = moved_by(problem, solution, torques)
        shown = sizes_shown(problem, solution, torques, moved)
        away = np.array([published(problem, x, starts) for x in moved])
        away -= published(problem, solution.x, starts)
        for size in (min(shown, 1.0), 1.0, max(shown, 1.0)):  # links that are worse excuse nothing
            with_links = covariance + size**2 * away.T @ away
            identified = values_of(problem, solution, starts, joints, with_links)
            refuted = refutation(errors, identified) if size <= 1.0 else refuted
            if refuted is None and size >= shown:
                break
        covariance = with_links
    fit = DriveFit(
        recording.name, recording.metadata.robot, EFFORT_UNITS[prefix], identified, errors,
        covariance, signals[0].cutoff, sum(float(np.ptp(s.t)) for s in signals), len(problem.use),
        refuted, link_errors=size, by_errors=away,
    )  # fmt: skip
    pull = np.concatenate([s.filtered(_of_gravity(recording, s), s.coarse) for s in signals])
    stated = np.asarray(Model.of(arm_of(recording), recording.metadata).gravity)
    return fit, followed_gravity(problem, pull, stated)


def _of_gravity(recording: Recording, signals: DriveSignals) -> np.ndarray:
    """Torques (M, J, 3), in every ``coarse``-th row, per unit of gravity along each base axis."""
    robot, q = arm_of(recording), signals.q.v[:: signals.coarse]
    theta = robot.robot_theta(Model.of(robot, recording.metadata).configured(recording.metadata))
    return np.stack([-robot.gravity_torque(q, theta, axis) for axis in np.eye(3)], axis=2)


def by_ordinary_errors(
    recording: Recording, signals: Sequence[DriveSignals], problem: Problem, solution: Solution
) -> np.ndarray:
    """Filtered efforts (M, J, H) by one ordinary error each, of links, of torques' gains and of
    friction (`by_each`); 0 of gains that are free, and of friction that is not."""
    gain, _, friction = parts(problem, solution.x)
    level = np.zeros(len(gain))
    if FRICTION[0] in problem.kinds:
        level = friction[:, problem.kinds.index(FRICTION[0])] / gain
    total = (problem.y - residual(problem, solution.x)) * (not problem.gains)
    of_links, after_reversals = [], []
    for s in signals:
        _, inertias, _, y = _rigid(recording, s)
        of_links.append(s.filtered(y @ link_errors(inertias.phi), s.coarse))
        after_reversals.append(s.filtered(after_reversal(s.q, level)))
    return by_each(np.concatenate(of_links), np.concatenate(after_reversals), total)


def _rigid(r: Recording, s: DriveSignals) -> tuple[np.ndarray, LinkInertias, Jet, np.ndarray]:
    """Parameters (P,) of the arm, its links' inertias, its motion (M, J) in every ``s.coarse``-th
    row, and the torques (M, J, 10 L) there by each inertial parameter of its L links."""
    robot = arm_of(r)
    model = Model.of(robot, r.metadata)
    theta = robot.robot_theta(model.configured(r.metadata))
    q = Jet(*(part[:: s.coarse] for part in (s.q.v, s.q.d, s.q.dd)))
    torques = torque_regressor(robot, theta, q, np.asarray(model.gravity))
    return theta, link_inertias(robot, theta), q, torques


def _groups(free: Sequence[str], prefix: str, *, stated: bool, rest: bool) -> tuple[str, ...]:
    currents = prefix == "i"
    known = [g for g in AT_REST if g != CONSTANT or currents] if rest else GROUPS
    for name in free:
        if name not in (*known, "drive"):
            of, more = (" at rest", "; a motion tells more") if rest else ("", "")
            raise ParameterError(f"--free {name}: is none of drive, {', '.join(known)}{of}{more}")
    if stated and CONSTANT in free:
        raise ParameterError(f"--free {CONSTANT}: --constants states them; leave one of both out")
    drive = [g for g in known if g.startswith("drive") and not (g == CONSTANT and stated)]
    named = {g for f in free for g in (drive if f == "drive" else (f,))}
    wanted = named or {g for g in known if g != "link" and (g != CONSTANT or currents)}
    if currents and CONSTANT not in wanted:
        raise ParameterError(f"--free: currents need {CONSTANT}, or --constants that are known")
    if "link" in wanted and CONSTANT in wanted:
        raise ParameterError("--free link and drive.constant: both scale the torques; hold one")
    return tuple(g for g in GROUPS if g in wanted and not (g == "tool" and "link" in wanted))


def problem_of(
    recording: Recording, signals: Sequence[DriveSignals], groups: tuple[str, ...]
) -> tuple[Problem, dict[str, float]]:
    """Least-squares problem of all pieces (``signals``) of a motion, with columns for the free
    parameters of ``groups`` (of `GROUPS`), and nominal values of load, links and rotors by name."""
    parts, starts = zip(*(_of_piece(recording, s, groups) for s in signals), strict=True)
    y, nominal, loads, own, use = (
        np.concatenate([getattr(p, name) for p in parts])
        for name in ("y", "nominal", "loads", "own", "use")
    )
    fold = np.arange(len(y)) * FOLDS // len(y)
    whole = replace(parts[0], y=y, nominal=nominal, loads=loads, own=own, use=use, fold=fold)
    return whole, starts[0]


def _of_piece(
    recording: Recording, signals: DriveSignals, groups: tuple[str, ...]
) -> tuple[Problem, dict[str, float]]:
    robot, coarse = arm_of(recording), signals.coarse
    theta, inertias, q, y = _rigid(recording, signals)
    nominal = y @ inertias.phi.ravel() + rotor_torque(robot, theta, inertias, q)
    starts: dict[str, float] = {}
    spread = np.zeros(0)
    if "link" in groups:
        base = BaseParameters(robot, theta)
        loads, changes = y[..., base.columns], base.names
        starts = dict(zip(changes, base.grouping @ inertias.phi.ravel(), strict=True))
        spread = np.full(len(changes), np.inf)
    elif "tool" in groups:
        loads, changes = load_torques(y, robot, theta), LOAD
        tool = replace(robot.tool(theta), sensor_mass=np.zeros(()))
        starts = dict(zip(changes, tool.inertial, strict=True))
        reach = float(np.linalg.norm(robot.sensor_pose(np.asarray(robot.home)[None], theta)[1]))
        spread = inertias.phi[:, 0].sum() * (_LEVER * reach) ** _POWER
    else:
        loads, changes = y[..., :0], ()
    if FRICTION[3] in groups:
        starts |= {f"{FRICTION[3]}.{j + 1}": float(r) for j, r in enumerate(inertias.rotor)}
    friction, kinds = _friction(signals, groups)
    use = signals.moving()
    if FRICTION[0] not in kinds:
        use = np.ones_like(use)
    problem = Problem(
        signals.filtered(signals.effort), signals.filtered(nominal, coarse),
        signals.filtered(loads, coarse), changes, signals.filtered(friction), kinds, use,
        np.zeros(len(use), dtype=int), CONSTANT in groups, spread,
    )  # fmt: skip
    return problem, starts


def arm_of(recording: Recording) -> SimulatedRobot:
    """Robot of a recording, with a model of its links.

    Raises:
        NotFoundError: the robot has no model with links.
    """
    robot = robot_of(recording)
    if not isinstance(robot, SimulatedRobot):
        raise NotFoundError(f"robot {robot.name!r} has no model: its joints have no torques")
    return robot


def _friction(signals: DriveSignals, groups: tuple[str, ...]) -> tuple[np.ndarray, tuple[str, ...]]:
    """Columns (N, J, F) of each joint's friction, offset, rotor, and names of the F of them."""
    speed, kinds = signals.q.d, tuple(g for g in FRICTION if g in groups)
    shapes = (np.sign(speed), speed, np.ones_like(speed), signals.q.dd)
    columns = [shape for kind, shape in zip(FRICTION, shapes, strict=True) if kind in kinds]
    return np.stack(columns, axis=-1) if columns else np.zeros((*speed.shape, 0)), kinds


def check_moves(name: str, problem: Problem) -> None:
    """Raise CalibrationError on recording ``name`` if few rows remain or a joint never moves."""
    use = problem.use
    rows = len(use)
    if rows < 2 * FOLDS or not use.any(axis=0).all():
        lazy = [j + 1 for j in range(use.shape[1]) if not use[:, j].any()]
        why = f"joint {lazy[0]} never moves" if lazy else f"{rows} rows are left after the filter"
        raise CalibrationError(f"{name}: {why}: record a longer motion of all joints")


def load_torques(y: np.ndarray, robot: SimulatedRobot, theta: np.ndarray) -> np.ndarray:
    """Torques (N, J, 10) by each number of `LOAD`, from the arm's regressor y (N, J, 10 L)."""
    q = np.asarray(robot.home, dtype=float)[None]
    link, origin = at_home(*robot.link_frames(q, theta)[robot.carrier])
    rotation, place = (np.asarray(v)[0] for v in robot.sensor_pose(q, theta))
    turn, lever = link.T @ rotation, link.T @ (place - origin)
    result = np.zeros((INERTIAL, INERTIAL))
    result[:, 0] = of_mass(lever)
    result[:, 1:4] = np.stack([of_moment(lever, axis) for axis in turn.T], axis=1)
    turned = [six_of(turn @ symmetric(unit) @ turn.T) for unit in np.eye(6)]
    result[4:, 4:] = np.stack(turned, axis=1)
    carrier = slice(INERTIAL * robot.carrier, INERTIAL * (robot.carrier + 1))
    return np.asarray(y[..., carrier] @ result)


def values_of(
    problem: Problem, solution: Solution, starts: dict[str, float], joints: Sequence[Joint],
    covariance: np.ndarray,
) -> tuple[IdentifiedValue, ...]:  # fmt: skip
    """Parameters as published, with covariance (K, K); ``starts``: nominal values by name."""
    std = np.sqrt(np.diagonal(covariance))
    names, determined = _names(problem, _certain(problem, solution, starts, std), joints)
    values = published(problem, solution.x, starts)
    before = published(problem, start(problem), starts)
    return identified_values(names, values, std, before, determined, WIDE)


def jackknife(folds: np.ndarray) -> np.ndarray:
    """Covariance (K, K) by the jackknife, from values (FOLDS, K) of fits without each block."""
    off = folds - folds.mean(axis=0)
    return np.asarray((FOLDS - 1) / FOLDS * off.T @ off)


def _certain(p: Problem, s: Solution, starts: dict[str, float], std: np.ndarray) -> np.ndarray:
    """Whether the data determine each parameter (K,) with standard uncertainties ``std`` (K,),
    boolean; divisors must surely differ from 0.

    The interval of 1/g is unbounded where that of g contains zero (Fieller 1954), and a mass that
    may be zero has no centre.
    """
    determined = s.determined.copy()
    half = WIDE * np.sqrt(np.diagonal(jackknife(s.folds)))
    if p.gains:
        joints = p.y.shape[1]
        determined[:joints] &= np.abs(s.x[:joints]) > half[:joints]
    if p.changes == LOAD:
        at = p.y.shape[1] * p.gains
        light = abs(s.x[at] + starts[LOAD[0]]) <= WIDE * std[at]
        determined[at + 1 : at + len(LOAD)] &= not light
    return determined


def _names(
    p: Problem, determined: np.ndarray, joints: Sequence[Joint]
) -> tuple[list[tuple[str, str]], np.ndarray]:
    """(Name, unit) of each published parameter; whether it is determined, from flags (K,)."""

    def of_joints(kind: str, unit: str) -> list[tuple[str, str]]:
        return [(f"{kind}.{j}", joint.own(unit)) for j, joint in enumerate(joints, start=1)]

    gain, changes, friction = parts(p, determined)
    names = of_joints(CONSTANT, "N·m/A") if p.gains else []
    good = [*gain] if p.gains else []
    if p.changes == LOAD:
        names += [("tool.mass", "kg"), *((c, "m") for c in _COG), *((c, "kg·m²") for c in _INERTIA)]
        cog = changes[0] & changes[1:4]
        good += [changes[0], *cog, *(cog.all() & changes[4:])]
    else:
        names += [(c, _LINK_UNITS.get(c.rpartition(".")[2], "kg·m²")) for c in p.changes]
        good += [*changes]
    for f, kind in enumerate(p.kinds):
        names += of_joints(kind, _UNITS[kind])
        good += [*(friction[:, f] & gain)]
    return names, np.array(good, dtype=bool)


def published(p: Problem, x: np.ndarray, starts: dict[str, float]) -> np.ndarray:
    """Parameters (K,) as published (mass, centre …) from a fit's x (K,) and nominal ``starts``."""
    gain, change, friction = parts(p, x)
    change = change + [starts[c] for c in p.changes]
    if p.changes == LOAD:
        mass, cog, inertia = about_centre(change)
        change = np.array([mass, *cog, *six_of(inertia)])
    known = [[starts.get(f"{k}.{j + 1}", 0.0) for k in p.kinds] for j in range(len(gain))]
    friction = friction / gain[:, None] + known
    return np.concatenate([1.0 / gain if p.gains else gain[:0], change, friction.T.ravel()])


def errors_of(p: Problem, solution: Solution, units: Sequence[str]) -> tuple[JointError, ...]:
    """Errors of each joint, in ``units``; on held-out blocks of time by the fits without them."""
    unseen = np.zeros_like(p.y)
    for k, x in enumerate(solution.folds):
        unseen[p.fold == k] = residual(p, x)[p.fold == k]
    nominal = None if p.gains else p.y - p.nominal
    return joint_errors(p.y, nominal, residual(p, solution.x), unseen, p.use, units)


def refutation(joints: Sequence[JointError], values: Sequence[IdentifiedValue]) -> str | None:
    """Sentence on why held-out rows or an impossible value refute a fit; None if they do not."""
    bad = [e for e in joints if not e.held_out < _WORSE * e.measured]
    if bad:
        return (
            f"of joint {', '.join(str(e.joint) for e in bad)} the fit explains nothing on rows "
            f"that it did not see (error {bad[0].held_out:.3g}, spread {bad[0].measured:.3g})"
        )
    return impossible(values)
