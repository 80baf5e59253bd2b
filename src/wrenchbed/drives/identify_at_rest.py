"""Payload, zeros of torque sensors and drive constants of an arm, from its joints' efforts at rest.

y = g (τ₀ + P δ + z) + friction: τ₀ the torque that holds the stated arm, P δ that of changes δ of
the load's mass and first moment, z zeros, g = 1/K of drive constants K where currents are measured.
Static friction holds a joint anywhere within a band: what follows the direction of approach has a
prior, the rest is noise of each joint from pose to pose. Stated links, sensors and zeros of joints
have ordinary errors, whose common size is fitted too (`channels.hierarchical_fit`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtrit  # scipy.stats takes a second to load

from wrenchbed.calibration.fit import IdentifiedValue, identified_values
from wrenchbed.channels.effort import CHANNEL, GAIN
from wrenchbed.channels.hierarchical_fit import Posterior, posterior
from wrenchbed.channels.holding_torques import held_weight, held_wrench, nominal_twists
from wrenchbed.data.holds import first_rows
from wrenchbed.data.recording import EFFORT_UNITS, Recording
from wrenchbed.drives.effort_fit import AtRest, DriveFit, impossible, joint_errors
from wrenchbed.drives.signals import efforts_of
from wrenchbed.effects.scene import Scene
from wrenchbed.errors import CalibrationError
from wrenchbed.physics.rotations import cross
from wrenchbed.robots.base import Joint, SimulatedRobot
from wrenchbed.simulation.closed_form import Model

OFFSET, CONSTANT, TOOL = "drive.offset", "drive.constant", "tool"
GROUPS = (OFFSET, CONSTANT, TOOL)
"""Groups that may be free at rest."""
LEAST_POSES = 10
"""Fewest poses: noise, zero and friction of each joint, and a payload, come from its readings."""
JOINT_ZERO = 1e-3
"""Ordinary error of a joint's zero [rad or m]: 0.06°, of a calibrated arm."""
FOLDS = 10
"""Parts of the poses, each of which is held out once."""
_SHARED = 4
"""Free parameters of a joint and of the load, which are subtracted from the number of poses."""
_STEP = 1e-4
"""Step of central differences by joint values [rad or m]."""
_ROUNDS, _SETTLED = 30, 1e-9
"""Steps of the fit of drive constants at most, and relative change that ends them."""
_NOTHING = 0.5
"""Error on held-out poses over the spread of the efforts, from which the fit is refuted: real arms
leave less than a tenth."""
_Columns = tuple[np.ndarray, np.ndarray, dict[str, np.ndarray], np.ndarray]
"""Linearised fit: residual efforts (N,), columns (N, …) of free parameters and gains, of ordinary
errors by kind, and of friction."""


@dataclass(frozen=True, eq=False)
class RestProblem:
    """Measured efforts of H poses at rest, and the torques that may explain them.

    Attributes:
        y: measured efforts (H, J) [N·m, of slides N; A].
        nominal: torques of the stated arm and tool (H, J).
        load: torques per unit of mass and first moment (H, J, 4); (H, J, 0) if the tool is fixed.
        zeros: torques per unit zero (H, J, J); (H, J, 0) where zeros are fixed.
        ordinary: torques of errors that every robot has, by kind (H, J, m).
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
    rows: np.ndarray,
    prefix: str,
    groups: Sequence[str],
) -> DriveFit:
    """Fit ``groups`` (of `GROUPS`) to efforts (N, J) of poses at rest; prefix: ``tau`` or ``i``.

    Raises:
        CalibrationError: too few poses.
    """
    scene, y = _poses(recording, robot, rows)
    problem = _problem(scene, y, groups)
    gain, columns, fit = _fitted(problem)
    stated = scene.tool.mass * np.append(1.0, scene.tool.cog)
    identified, covariance = _identified(robot.joints, stated, problem, gain, fit)
    sizes = dict(zip(columns[2], fit.sizes.tolist(), strict=True))
    units = [joint.own(EFFORT_UNITS[prefix]) for joint in robot.joints]
    nominal = None if problem.gains else y - problem.nominal
    unseen, use = _held_out(columns, fit, y.shape[1]), np.ones(y.shape, dtype=bool)
    rest = (columns[0] - fit.fitted).reshape(y.shape)
    errors = joint_errors(y, nominal, rest, unseen, use, units)
    result = DriveFit(
        recording.name, recording.metadata.robot, EFFORT_UNITS[prefix], identified,
        errors, covariance, None,
        float(recording.t[-1] - recording.t[0]), len(recording),
        rest=AtRest(len(y), tuple(fit.noise.tolist()), sizes),
    )  # fmt: skip
    return replace(result, refuted=_refuted(result))


def _poses(
    recording: Recording, robot: SimulatedRobot, rows: np.ndarray
) -> tuple[Scene, np.ndarray]:
    """Scene of a recording's H poses at rest, and the poses' means (H, J) of ``rows`` (N, J)."""
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
    return Scene(robot, theta, np.asarray(model.gravity), q, t, held_rows), y


def added_load(
    first: Recording, second: Recording, robot: SimulatedRobot
) -> tuple[IdentifiedValue, ...]:
    """Mass and centre of gravity of what an arm carries in a second recording of torques at rest
    beyond what it carries in a first one.

    Errors of links, of joints' zeros and of sensors' gains are the same in both and drop out; zeros
    of the torque sensors are each recording's own.

    Raises:
        CalibrationError, RecordingError: too few poses, or no torques.
    """
    (one, y), (other, more) = (_poses(r, robot, efforts_of(r)[1]) for r in (first, second))
    q, t = (np.concatenate([getattr(s, k) for s in (one, other)]) for k in ("joints", "t"))
    scene = replace(one, q=q, t=t, held=np.ones(len(t), dtype=bool))
    p = _problem(scene, np.concatenate([y, more]), (TOOL, OFFSET))
    later = (np.arange(len(p.y)) >= len(y))[:, None, None]
    beside = np.concatenate([p.zeros, later * p.zeros, p.load], axis=2)
    friction = np.concatenate([~later * p.friction, later * p.friction], axis=2)
    p = replace(p, load=later * p.load, zeros=beside, friction=friction)
    gain, _, fit = _fitted(p)
    return _identified(robot.joints, np.zeros(4), p, gain, fit)[0][:4]


def _fitted(p: RestProblem) -> tuple[np.ndarray, _Columns, Posterior]:
    """Solve a problem: gains (J,), the problem linearised about these, and its fit."""
    gain, x = _gains(p)
    columns = y, free, ordinary, friction = _columns(p, gain, x)
    joint = np.tile(np.arange(p.y.shape[1]), len(p.y))
    return gain, columns, posterior(y, free, tuple(ordinary.values()), friction, joint)


def _problem(scene: Scene, y: np.ndarray, groups: Sequence[str]) -> RestProblem:
    robot, q, theta, joints = scene.robot, scene.joints, scene.theta, y.shape[1]
    rotation, _ = robot.sensor_pose(q, theta)
    down = np.broadcast_to(scene.gravity @ rotation, (len(q), 3))
    none = np.zeros_like(down)
    units = [np.concatenate([down, none], axis=1)]
    units += [np.concatenate([none, cross(axis, down)], axis=1) for axis in np.eye(3)]
    load = held_wrench(nominal_twists(scene), np.stack(units, axis=2))
    zeros = np.broadcast_to(np.eye(joints), (len(q), joints, joints))
    (_, zero), (friction, links) = replace(CHANNEL, joints=joints).kinds(scene)
    shifts = _STEP * np.eye(joints)
    up, down_ = ([held_weight(robot, q + s * x, theta, scene.gravity[None]) for x in shifts]
                 for s in (1.0, -1.0))  # fmt: skip
    turned = np.stack(up, axis=2) - np.stack(down_, axis=2)
    ordinary = {"links": links, "joint zeros": JOINT_ZERO / (2.0 * _STEP) * turned}
    ordinary |= {} if OFFSET in groups else {"torque zeros": zero}
    return RestProblem(
        y, -scene.joint_torque, load if TOOL in groups else load[..., :0],
        zeros if OFFSET in groups else zeros[..., :0], ordinary, friction, CONSTANT in groups,
    )  # fmt: skip


def _gains(p: RestProblem) -> tuple[np.ndarray, np.ndarray]:
    """Gains (J,) and other free parameters (F,) of a least-squares fit that assumes exact links."""
    joints = p.y.shape[1]
    x = np.zeros(p.free.shape[2])
    if not p.gains:
        wide = p.free.reshape(p.y.size, -1)
        x = np.linalg.lstsq(wide, (p.y - p.nominal).ravel(), rcond=1e-9)[0]
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
    """Linearise a problem about gains (J,) and values x (F,) of its other free parameters."""
    free, ordinary = gain[:, None] * p.free, dict(p.ordinary)
    of_gains = _of_gains(p.nominal + p.free @ x)
    if p.gains:
        free = np.concatenate([free, of_gains], axis=2)
    else:
        ordinary["torque gains"] = GAIN * of_gains

    def flat(torques: np.ndarray) -> np.ndarray:
        return (gain[:, None] * torques).reshape(p.y.size, -1)

    y = (p.y - gain * p.nominal).ravel()
    every = {kind: flat(torques) for kind, torques in ordinary.items()}
    return y, free.reshape(p.y.size, -1), every, flat(p.friction)


def _held_out(columns: _Columns, fit: Posterior, joints: int) -> np.ndarray:
    """Residuals of efforts (H, J), each pose by a fit of others with noise, sizes of ``fit``."""
    y, free, ordinary, friction = columns
    sized = (s * errors for s, errors in zip(fit.sizes, ordinary.values(), strict=True))
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
    joints: Sequence[Joint], load: np.ndarray, p: RestProblem, gain: np.ndarray, fit: Posterior
) -> tuple[tuple[IdentifiedValue, ...], np.ndarray]:
    """Parameters as published and their covariance (K, K), from a fit's changes of the stated
    ``load`` (4,), mass [kg] and first moment [kg·m], and its zeros and ``gain`` (J,)."""
    loads, zeros, gains = p.load.shape[2], min(p.zeros.shape[2], len(joints)), len(gain) * p.gains
    names = [("tool.mass", "kg"), *((f"tool.cog.{a}", "m") for a in "xyz")][:loads]
    for kind, unit, count in ((OFFSET, "N·m", zeros), (CONSTANT, "N·m/A", gains)):
        names += [(f"{kind}.{j}", joint.own(unit)) for j, joint in enumerate(joints[:count], 1)]
    begun = np.concatenate([load[:loads], np.zeros(zeros), gain[:gains]])
    some = slice(len(begun))
    values, covariance = begun + fit.free[some], fit.covariance[some, some]
    slopes, determined = np.eye(len(begun)), fit.determined[some].copy()
    wide = float(stdtrit(max(len(p.y) - _SHARED, 1), 0.975))
    surely = np.abs(values) > wide * np.sqrt(np.diagonal(covariance))  # above or below 0
    if loads:
        determined[1:4] = determined[:4].all() and surely[0]  # no mass has no centre
        values[1:4] /= values[0]
        slopes[1:4, :4] = np.column_stack([-values[1:4], np.eye(3)]) / values[0]
        begun[1:4] /= begun[0] or 1.0
    if gains:
        determined[-gains:] &= surely[-gains:]
        values[-gains:], begun[-gains:] = 1.0 / values[-gains:], 1.0 / begun[-gains:]
        slopes[-gains:, -gains:] = np.diag(-(values[-gains:] ** 2))
    covariance = slopes @ covariance @ slopes.T
    spread = np.sqrt(np.diagonal(covariance))
    return identified_values(names, values, spread, begun, determined, wide), covariance


def _refuted(fit: DriveFit) -> str | None:
    if fit.explained >= 1.0 - _NOTHING:
        return impossible(fit.identified)
    if any(p.name == "tool.mass" and p.std is None for p in fit.identified):
        return (
            "the poses are too alike: in all of them the load adds the same to each joint, as a "
            "zero does. Record postures that differ in all joints"
        )
    return (
        f"on poses that the fit did not see it leaves {100.0 * (1.0 - fit.explained):.0f} % of "
        "the efforts: another robot, other joints, or the controller subtracted what it knows"
    )
