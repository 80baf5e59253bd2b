"""Payload, zeros of torque sensors and drive constants of an arm, from its joints' efforts at rest.

y = g (τ₀ + P δ + z) + friction: τ₀ the torque that holds the stated arm, δ changes of the load's
mass and first moment, z zeros, and g = 1/K where currents are measured. Static friction holds a
joint at rest anywhere within a band: the part that follows the direction of approach has a prior,
the rest is noise from pose to pose, of each joint. Stated links, sensors and zeros of joints have
ordinary errors, whose common size is fitted too (`channels.posterior`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtrit  # scipy.stats takes a second to load

from wrenchbed.calibration.fit import IdentifiedValue, identified_values
from wrenchbed.channels.effort import CHANNEL
from wrenchbed.channels.holding_torques import held_weight, held_wrench, nominal_twists
from wrenchbed.channels.posterior import Posterior, posterior
from wrenchbed.data.holds import first_rows
from wrenchbed.data.recording import EFFORT_UNITS, Recording
from wrenchbed.drives.fit import AtRest, DriveFit, impossible, joint_errors
from wrenchbed.drives.signals import as_torques, efforts_of
from wrenchbed.effects.scene import Scene
from wrenchbed.errors import CalibrationError, ParameterError
from wrenchbed.physics.rotations import cross
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.simulation.closed_form import Model

OFFSET, CONSTANT, TOOL = "drive.offset", "drive.constant", "tool"
"""Groups that may be free at rest."""
LEAST_POSES = 10
"""Fewest poses: each joint's noise, zero and friction, and a payload of four numbers, come from its
own readings."""
JOINT_ZERO = 1e-3
"""Ordinary error of a joint's zero [rad or m]: 0.06°, of a calibrated arm."""
FOLDS = 10
"""Parts of the poses, each of which is held out once."""
_SHARED = 4
"""Free numbers of a joint and of the load together, that degrees of freedom are counted off."""
_STEP = 1e-4
"""Step of central differences by joint values [rad or m]."""
_ROUNDS, _SETTLED = 30, 1e-9
"""Steps of the fit of drive constants at most, and relative change that ends them."""
_NOTHING = 0.5
"""Error on held-out poses over the spread of the efforts from which the robot is another one: real
arms leave less than a tenth."""
_SMALL = 1e-3
"""Step of central differences of what is published, in standard uncertainties."""
_Columns = tuple[np.ndarray, np.ndarray, tuple[np.ndarray, ...], np.ndarray]
"""Linearised fit: residual efforts (N,), columns (N, …) of free parameters and gains, of ordinary
errors by kind, and of friction."""


@dataclass(frozen=True, eq=False)
class RestProblem:
    """Measured efforts of H poses at rest, and the torques that may explain them.

    Attributes:
        y: measured efforts (H, J) [N·m, of slides N; A].
        nominal: torques of the stated arm and tool (H, J).
        load: torques per unit of mass and first moment (H, J, 4); (H, J, 0) where the tool is held.
        zeros: torques per unit zero (H, J, J); (H, J, 0) where zeros are held.
        ordinary: torques of ordinary errors by kind (H, J, m).
        friction: torques by direction of approach (H, J, J), one standard deviation each.
        gains: whether each joint has a free gain g.
    """

    y: np.ndarray
    nominal: np.ndarray
    load: np.ndarray
    zeros: np.ndarray
    ordinary: Mapping[str, np.ndarray]
    friction: np.ndarray
    gains: bool

    @property
    def free(self) -> np.ndarray:
        """Torques per unit of each free parameter except gains (H, J, F)."""
        return np.concatenate([self.load, self.zeros], axis=2)


def calibrate_at_rest(
    recording: Recording,
    robot: SimulatedRobot,
    free: Sequence[str] = (),
    constants: Sequence[float] | None = None,
) -> DriveFit:
    """Fit payload, zeros and drive constants to efforts at rest, one row a pose or many.

    Args:
        free: of ``tool``, ``drive.offset`` and ``drive.constant``, or ``drive`` for both of these;
            if none, all that can be.
        constants: known drive constants (J,) [N·m/A, of slides N/A].

    Raises:
        CalibrationError, RecordingError: no efforts, or too few poses.
        ParameterError: ``free`` names what poses at rest do not determine.
    """
    prefix, rows = efforts_of(recording)
    if constants is not None:
        rows = as_torques(rows, prefix, constants, recording.name)
        prefix = "tau"
    groups = _groups(free, currents=prefix == "i")
    model = Model.of(robot, recording.metadata)
    theta = robot.robot_theta(model.configured(recording.metadata))
    starts = first_rows(recording.columns)
    if len(starts) < LEAST_POSES:
        raise CalibrationError(
            f"{recording.name}: {len(starts)} poses at rest: a fit of joint efforts needs "
            f"{LEAST_POSES} or more, better 40, in varied postures"
        )
    count = np.diff(np.append(starts, len(recording)))

    def means(x: np.ndarray) -> np.ndarray:
        return np.asarray((np.add.reduceat(x.astype(float), starts, axis=0).T / count).T)

    t, q, y = means(recording.t), means(recording.q), means(rows)
    held_rows = np.ones(len(t), dtype=bool)
    scene = Scene(robot, theta, np.asarray(model.gravity), q, t, held_rows)
    problem = _problem(scene, y, groups)
    gain, x = _gains(problem)
    columns = _columns(problem, gain, x)
    joint = np.tile(np.arange(y.shape[1]), len(t))
    fit = posterior(*columns, joint)
    identified, covariance = _identified(scene, problem, gain, fit)
    sizes = dict(zip(problem.ordinary, fit.sizes.tolist(), strict=True))
    units = [joint.own(EFFORT_UNITS[prefix]) for joint in robot.joints]
    nominal = None if problem.gains else y - problem.nominal
    unseen, use = _held_out(columns, fit, y.shape[1]), np.ones(y.shape, dtype=bool)
    rest = (columns[0] - fit.fitted).reshape(y.shape)
    errors = joint_errors(y, nominal, rest, unseen, use, units)
    result = DriveFit(
        recording.name, recording.metadata.robot, EFFORT_UNITS[prefix], identified,
        errors, covariance, None,
        float(recording.t[-1] - recording.t[0]), len(recording),
        rest=AtRest(len(t), tuple(fit.noise.tolist()), sizes),
    )  # fmt: skip
    return replace(result, refuted=_refuted(result))


def _groups(free: Sequence[str], *, currents: bool) -> frozenset[str]:
    known = {TOOL, OFFSET, *((CONSTANT,) if currents else ())}
    for name in free:
        if name not in (*known, "drive"):
            raise ParameterError(
                f"--free {name}: at rest only {', '.join(sorted(known))} can be told (constants of "
                "currents alone); a motion tells more"
            )
    groups = frozenset(g for f in free for g in ((known - {TOOL}) if f == "drive" else {f}))
    if currents and groups and CONSTANT not in groups:
        raise ParameterError(f"--free: currents need {CONSTANT}, or --constants that are known")
    return groups or frozenset(known)


def _problem(scene: Scene, y: np.ndarray, groups: frozenset[str]) -> RestProblem:
    robot, q, theta, joints = scene.robot, scene.joints, scene.theta, y.shape[1]
    rotation, _ = robot.sensor_pose(q, theta)
    down = np.broadcast_to(scene.gravity @ rotation, (len(q), 3))
    none = np.zeros_like(down)
    units = [np.concatenate([down, none], axis=1)]
    units += [np.concatenate([none, cross(axis, down)], axis=1) for axis in np.eye(3)]
    load = held_wrench(nominal_twists(scene), np.stack(units, axis=2))
    zeros = np.broadcast_to(np.eye(joints), (len(q), joints, joints))
    channel = replace(CHANNEL, joints=joints)
    (gain, zero), (friction, links) = channel.kinds(scene)
    shifts = _STEP * np.eye(joints)
    up, down_ = ([held_weight(robot, q + s * x, theta, scene.gravity[None]) for x in shifts]
                 for s in (1.0, -1.0))  # fmt: skip
    turned = np.stack(up, axis=2) - np.stack(down_, axis=2)
    ordinary = {"links": links, "joint zeros": JOINT_ZERO / (2.0 * _STEP) * turned}
    ordinary |= {} if CONSTANT in groups else {"torque gains": gain}
    ordinary |= {} if OFFSET in groups else {"torque zeros": zero}
    return RestProblem(
        y, -scene.joint_torque, load if TOOL in groups else load[..., :0],
        zeros if OFFSET in groups else zeros[..., :0], ordinary, friction, CONSTANT in groups,
    )  # fmt: skip


def _gains(p: RestProblem) -> tuple[np.ndarray, np.ndarray]:
    """Gains (J,) and free parameters (F,) of the least-squares fit without ordinary errors."""
    joints = p.y.shape[1]
    x = np.zeros(p.free.shape[2])
    if not p.gains:
        return np.ones(joints), x
    away = p.nominal - p.nominal.mean(axis=0)
    square = (away**2).sum(axis=0)
    gain = (away * p.y).sum(axis=0) / np.maximum(square, 1e-300)
    weighty = square > 1e-6 * square.max()
    gain = np.where(weighty, gain, np.median(gain[weighty]))
    for _ in range(_ROUNDS):
        body = p.nominal + p.free @ x
        design = np.concatenate([_of_gains(body), gain[:, None] * p.free], axis=2)
        residual = (p.y - gain * body).ravel()
        step = np.linalg.lstsq(design.reshape(len(residual), -1), residual, rcond=1e-9)[0]
        gain, x = gain + step[:joints], x + step[joints:]
        if np.abs(step).max() <= _SETTLED * max(1.0, float(np.abs(x).max())):
            break
    return gain, x


def _of_gains(body: np.ndarray) -> np.ndarray:
    """Columns (H, J, J) of each joint's gain error: torques (H, J) as diagonal matrices."""
    return np.asarray(body[:, :, None] * np.eye(body.shape[1]))


def _columns(p: RestProblem, gain: np.ndarray, x: np.ndarray) -> _Columns:
    """Problem linearised about gains (J,) and free parameters x (F,)."""
    free = gain[:, None] * p.free
    if p.gains:
        free = np.concatenate([free, _of_gains(p.nominal + p.free @ x)], axis=2)

    def flat(torques: np.ndarray) -> np.ndarray:
        return (gain[:, None] * torques).reshape(p.y.size, -1)

    ordinary = tuple(flat(torques) for torques in p.ordinary.values())
    y = (p.y - gain * p.nominal).ravel()
    return y, free.reshape(p.y.size, -1), ordinary, flat(p.friction)


def _held_out(columns: _Columns, fit: Posterior, joints: int) -> np.ndarray:
    """Errors of efforts (H, J) at poses left out of a fit with the same noise and sizes."""
    y, free, ordinary, friction = columns
    sized = (s * errors for s, errors in zip(fit.sizes, ordinary, strict=True))
    wide = np.column_stack([free, *sized, friction])
    weight = 1.0 / np.tile(fit.noise, len(y) // joints)
    prior = np.diag(np.repeat([0.0, 1.0], [free.shape[1], wide.shape[1] - free.shape[1]]))
    fold = np.arange(len(y)) // joints % FOLDS
    errors = np.empty_like(y)
    for k in range(FOLDS):
        seen = fold != k
        some = np.concatenate([wide[seen] * weight[seen, None], prior])
        goal = np.concatenate([y[seen] * weight[seen], np.zeros(len(prior))])
        errors[~seen] = y[~seen] - wide[~seen] @ np.linalg.lstsq(some, goal, rcond=1e-10)[0]
    return errors.reshape(-1, joints)


def _identified(
    scene: Scene, p: RestProblem, gain: np.ndarray, fit: Posterior
) -> tuple[tuple[IdentifiedValue, ...], np.ndarray]:
    """Published parameters, and their covariance (K, K) by linear propagation."""
    joints, stated = scene.robot.joints, np.append(scene.tool.mass, scene.tool.cog).astype(float)
    loads, zeros, gains = p.load.shape[2], p.zeros.shape[2], len(joints) * p.gains
    load = stated * np.append(1.0, np.full(3, stated[0]))

    def published(amplitudes: np.ndarray) -> np.ndarray:
        change, zero, more = np.split(amplitudes, [loads, loads + zeros])
        now = load[:loads] + change
        return np.concatenate([now[:1], now[1:] / now[:1], zero, 1.0 / (gain[:gains] + more)])

    std = np.sqrt(np.diagonal(fit.covariance))
    steps = np.diag(_SMALL * np.where(std > 0.0, std, 1.0))
    slopes = np.stack([
        (published(fit.free + step) - published(fit.free - step)) / (2.0 * step.max())
        for step in steps
    ], axis=1)  # fmt: skip
    covariance = slopes @ fit.covariance @ slopes.T
    wide, determined = float(stdtrit(max(len(p.y) - _SHARED, 1), 0.975)), fit.determined.copy()
    if loads:
        heavy = load[0] + fit.free[0] > wide * std[0]  # no mass has no centre
        determined[1:4] = fit.determined[:4].all() and heavy
    if gains:
        determined[-gains:] &= np.abs(gain + fit.free[-gains:]) > wide * std[-gains:]
    names = [("tool.mass", "kg"), *((f"tool.cog.{a}", "m") for a in "xyz")][:loads]
    for kind, unit, count in ((OFFSET, "N·m", zeros), (CONSTANT, "N·m/A", gains)):
        names += [(f"{kind}.{j}", joint.own(unit)) for j, joint in enumerate(joints[:count], 1)]
    begun = np.concatenate([stated[:loads], np.zeros(zeros), 1.0 / gain[:gains]])
    spread = np.sqrt(np.diagonal(covariance))
    values = published(fit.free)
    return identified_values(names, values, spread, begun, determined, wide), covariance


def _refuted(fit: DriveFit) -> str | None:
    alike = [p for p in fit.identified if p.name == "tool.mass" and p.std is None]
    if alike and fit.explained < 1.0 - _NOTHING:
        return (
            "the poses are too alike: in all of them the load adds the same to each joint, as a "
            "zero does. Record postures that differ in all joints"
        )
    if fit.explained < 1.0 - _NOTHING:
        return (
            f"on poses that the fit did not see it leaves {100.0 * (1.0 - fit.explained):.0f} % of "
            "the efforts: another robot, other joints, or the controller subtracted what it knows"
        )
    return impossible(fit.identified)
