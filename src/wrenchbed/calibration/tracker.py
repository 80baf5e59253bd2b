"""A robot's geometry from positions of a target on its flange, measured by a tracker.

m = T (x + R p) + s at joint values q + dq + c τ: x and R are the sensor's place and orientation, c
the joints' compliances under the torques τ of weight. The tracker's pose (T, s) and the target's
position (p) are fitted too, with so large a scale that they also take what geometry could explain
equally: a zero of the first joint turns everything that the tracker sees.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy  # which loads its slow submodules when they are first used
from scipy import special
from scipy.linalg import solve_triangular

from wrenchbed.calibration.calibrate import CalibrationOptions
from wrenchbed.calibration.checks.rows import usable
from wrenchbed.calibration.fit import IdentifiedValue, identified_values
from wrenchbed.calibration.least_squares import Solution, solve
from wrenchbed.calibration.observability import Observability
from wrenchbed.calibration.tracker_result import COMPLIANCE, TrackerFit
from wrenchbed.data.holds import gather
from wrenchbed.data.recording import TARGET, Recording
from wrenchbed.errors import CalibrationError
from wrenchbed.physics.model_parameters import Parameter, ParameterSet
from wrenchbed.physics.rotations import apply, exp
from wrenchbed.physics.taylor_jets import STEP
from wrenchbed.robots.base import Robot, complex_steps
from wrenchbed.simulation.closed_form import Model, robot_of

GIVE = {"rad": ("rad/(N·m)", 7e-5), "m": ("m/N", 3e-6)}
"""Unit and typical size of a joint's compliance, as the effect ``joint.compliance`` has it."""
FOLDS = 4
"""Number of parts of the poses, each held out once in cross-validation."""
_STAND = ParameterSet(
    tuple(
        Parameter(f"{name}.{a}", 0.0, unit, 10.0, -np.inf, np.inf)
        for name, unit in (
            ("tracker.rotation", "rad"), ("tracker.position", "m"), ("target.position", "m")
        )
        for a in "xyz"
    )
)  # fmt: skip
"""Tracker's pose, and target's position in sensor axes; tolerances far above any geometry's."""
_HIDDEN = ("base.tilt.", "mount.")
"""Groups of robot parameters that the tracker's pose and the target's position replace."""
_LOADED = 1e-3
"""Least range of the weight's torque that tells a joint's compliance from its zero [N·m, N]."""
_WIDE = 30.0
"""Standard deviation, in tolerances, of the weak prior of a fit without prior: an effect may be so
many times its typical size. Lengths along nearly parallel axes, which poses hardly tell, stay."""
_TOLD = 0.5
"""Largest posterior over prior standard uncertainty of a parameter that the data determine."""
_NOISE_STEPS, _SAME_NOISE = 5, 0.01
"""Most updates of the assumed noise by the residual, and the relative change that ends them."""
_LEAST_NOISE = 1e-7
"""Least noise assumed of a position [m], for readings without noise."""
_PLANNED_TARGET = (0.1, 0.0, 0.1)
"""Assumed position of the target in sensor axes [m] in a plan: a bracket beside the tool."""


@dataclass(frozen=True, eq=False)
class Sight:
    """Fit problem: H positions of a target on the flange, measured by a tracker, and robot model.

    Attributes:
        theta: stated parameters of the robot (P,).
        q: joint values (H, J).
        read: measured positions (H, 3) in the tracker's axes [m].
        columns: indices of the free geometric parameters.
        joints: indices from 0 of the joints with a free compliance.
        turn: rough rotation (3, 3) from world to tracker; a fitted rotation vector refines it.
    """

    model: Model
    theta: np.ndarray
    q: np.ndarray
    read: np.ndarray
    columns: tuple[int, ...]
    joints: tuple[int, ...]
    turn: np.ndarray

    @cached_property
    def parameters(self) -> ParameterSet:
        """All K free parameters: geometry, compliances, pose of tracker and position of target."""
        robot = self.model.robot
        give = [
            Parameter(f"{COMPLIANCE}{j + 1}", 0.0, *GIVE[robot.joints[j].unit], -1.0, 1.0)
            for j in self.joints
        ]
        return ParameterSet((*(robot.parameters[k] for k in self.columns), *give)) + _STAND

    @cached_property
    def start(self) -> np.ndarray:
        """Start values (K,) of the fit: stated geometry, no compliance, tracker roughly fitted."""
        x = np.concatenate([self.theta[list(self.columns)], np.zeros(len(self.joints) + 9)])
        middle = self._pose(self.q, self.theta)[1].mean(axis=0)
        x[-6:-3] = self.read.mean(axis=0) - self.turn @ middle
        return x

    @cached_property
    def torque(self) -> np.ndarray:
        """Torque of the weight about each joint (H, J) [N·m; N for slides]."""
        model = self.model
        return model.robot.gravity_torque(self.q, self.theta, np.asarray(model.gravity))

    def expected(self, x: np.ndarray) -> np.ndarray:
        """Predicted target positions (H, 3) [m], in the tracker's axes, at parameters x (K,)."""
        return self._seen(*self._pose(self._moved(x), self.geometry(x)), x[-9:])

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """Derivatives (H, 3, K) of the predicted positions at x (K,), by complex steps."""
        q, theta = self._moved(x), self.geometry(x)
        by_geometry = self._seen(*self._pose(q, complex_steps(theta, self.columns)), x[-9:])
        shifts = 1j * STEP * np.eye(self.q.shape[1])[list(self.joints)]
        bent = (q + shifts[:, None] * self.torque).reshape(-1, q.shape[1])
        by_joint = self._seen(*self._pose(bent, theta), x[-9:]).reshape(-1, len(q), 3)
        here = self._pose(q, theta)
        by_stand = [self._seen(*here, x[-9:] + 1j * STEP * unit) for unit in np.eye(9)]
        return np.moveaxis(np.concatenate([by_geometry, by_joint, by_stand]).imag / STEP, 0, 2)

    def solve(self, noise: float, tolerances: float, start: np.ndarray) -> Solution:
        """Least-squares fit from ``start`` (K,) for a noise [m]; each parameter's prior has its
        stated value as mean and ``tolerances`` times its tolerance as standard deviation."""
        scale, centre = self.parameters.tolerance, self.start
        pull = np.diag(1.0 / (tolerances * scale))

        def residual(x: np.ndarray) -> np.ndarray:
            white = (self.read - self.expected(x)).ravel() / noise
            return np.concatenate([white, pull @ (centre - x)])

        def jacobian(x: np.ndarray) -> np.ndarray:
            return np.concatenate([self.jacobian(x).reshape(-1, len(x)) / noise, pull])

        return solve(residual, jacobian, start, scale)

    def stand(self, x: np.ndarray) -> dict[str, float]:
        """Name → value of the tracker's pose and the target's position, at parameters x (K,)."""
        turn = exp(*x[-9:-6]) @ self.turn
        turn = scipy.spatial.transform.Rotation.from_matrix(turn).as_rotvec()
        return dict(zip(_STAND.names, [*turn.tolist(), *x[-6:].tolist()], strict=True))

    def geometry(self, x: np.ndarray) -> np.ndarray:
        """The robot's parameters (P,) with those that are free taken from x (K,)."""
        theta = self.theta.copy()
        theta[list(self.columns)] = x[: len(self.columns)]
        return theta

    def _moved(self, x: np.ndarray) -> np.ndarray:
        """Joint values (H, J) plus the joints' deflection under weight, at parameters x (K,)."""
        give = np.zeros(self.q.shape[1])
        give[list(self.joints)] = x[len(self.columns) : -9]
        return self.q + give * self.torque

    def _pose(self, q: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rotation (…, 3, 3) and position (…, 3) [m] of the sensor at theta, (P,) or (K, 1, P)."""
        rotation, position = self.model.robot.sensor_pose(q, theta)
        return rotation, np.broadcast_to(position, rotation.shape[:-1])

    def _seen(self, rotation: np.ndarray, position: np.ndarray, stand: np.ndarray) -> np.ndarray:
        """Target positions (H, 3) in the tracker's axes [m], for sensor poses. ``stand`` (9,): the
        tracker's rotation vector [rad] and shift [m], the target's position in sensor axes [m]."""
        turn = exp(*stand[:3]) @ self.turn
        return np.asarray((position + apply(rotation, stand[6:])) @ turn.T + stand[3:6])


def calibrate_tracker(
    recording: Recording, options: CalibrationOptions | None = None
) -> TrackerFit:
    """Fit a robot's geometry and joint compliances to positions mx my mz of a target at rest; by
    default all geometry is free, and the compliance of every joint that weight loads. A
    `CalibrationError` without such columns, with too few poses or, unless ``options.force``, with
    held-out poses predicted no better than by the stated geometry."""
    options = options or CalibrationOptions()
    sight, repeats, rows = _sight(recording, options)
    count, tolerances = sight.read.size, 1.0 if options.prior else _WIDE
    if count < len(sight.parameters) and not options.prior:
        raise CalibrationError(
            f"{recording.name}: {len(sight.q)} poses give {count} readings, too few for "
            f"{len(sight.parameters)} parameters: record more poses, --free fewer, or take the "
            "tolerances as a --prior"
        )
    noise, start = max(repeats, _LEAST_NOISE), sight.start
    for _ in range(_NOISE_STEPS):
        solution = sight.solve(noise, tolerances, start)
        residual, start = sight.read - sight.expected(solution.x), solution.x
        known = np.diagonal(solution.covariance) / (tolerances * sight.parameters.tolerance) ** 2
        used = len(known) - known.sum()  # trace of the projection on what is free
        dof = max(count - used, 1.0)
        rest = float(np.sqrt((residual**2).sum() / dof))
        before, noise = noise, max(repeats, rest, _LEAST_NOISE)
        if abs(noise / before - 1.0) < _SAME_NOISE:
            break
    x, covariance = solution.x, solution.covariance
    alone = replace(sight, columns=(), joints=())  # the geometry as it is stated
    held_out, bound = _held_out(sight, noise, tolerances, x)
    nominal, _ = _held_out(alone, noise, _WIDE, alone.solve(noise, _WIDE, alone.start).x)
    slopes = sight.jacobian(sight.start).reshape(count, -1)
    theta = sight.model.parameters.nominal
    theta[: len(sight.theta)] = sight.geometry(x)
    fit = TrackerFit(
        recording=recording.name,
        robot=recording.metadata.robot,
        converged=solution.converged,
        iterations=solution.steps,
        identified=_identified(sight, solution, dof, tolerances),
        theta=dict(zip(sight.model.parameters.names, theta.tolist(), strict=True)),
        gravity=tuple(float(g) for g in sight.model.gravity),
        stand=sight.stand(x),
        loose=float(np.sqrt(np.diagonal(covariance)[-9:-6].max())),
        covariance=covariance[:-9, :-9],
        noise=rest,
        repeats=repeats or None,
        held_out=held_out,
        before=nominal,
        bound=bound,
        accuracy=before * float(np.sqrt(used / len(sight.q))),
        extent=float(np.sqrt(sight.read.var(axis=0).sum())),
        residual=residual,
        poses=len(sight.q),
        rows=rows,
        observability=Observability(slopes, sight.parameters.names, sight.parameters.tolerance),
    )
    if fit.refuted is not None and not options.force:
        raise CalibrationError(f"{recording.name}: {fit.refuted}")
    return fit


def planned_slopes(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Derivatives (H, 3, K) [m] of a target's position at joint values (H, J) by every parameter
    that may be free, per standard deviation of its prior, at most 1 rad or 1 m."""
    model = Model.of(robot)
    theta = robot.robot_theta(model.parameters.nominal)
    sight = Sight(model, theta, q, np.zeros((len(q), 3)), (), (), np.eye(3))
    columns, joints = _free(robot, np.ptp(sight.torque, axis=0), CalibrationOptions())
    sight = replace(sight, columns=columns, joints=joints)
    x = sight.start
    x[-3:] = _PLANNED_TARGET
    return sight.jacobian(x) * np.minimum(_WIDE * sight.parameters.tolerance, 1.0)


def _sight(recording: Recording, options: CalibrationOptions) -> tuple[Sight, float, int]:
    """Set up a recording's fit; return it, the standard deviation [m] of a pose's mean by its
    repeats (0 without any), and the number of rows used."""
    name = recording.name
    if not all(c in recording.columns for c in TARGET):
        raise CalibrationError(f"{name}: no columns mx my mz: a tracker did not record this")
    if not recording.joints or recording.metadata.mode != "static":
        raise CalibrationError(f"{name}: a tracker's readings need joint columns, at rest")
    robot = robot_of(recording)
    model, keep = Model.of(robot, recording.metadata), usable(recording)
    holds = gather(recording, keep)
    robot.check(holds.q, robot.parameters.nominal, name)
    places = np.stack([recording.columns[c][keep] for c in TARGET], axis=1)
    read = np.add.reduceat(places, holds.rows) / holds.count[:, None]
    away, repeats = places - np.repeat(read, holds.count, axis=0), 0.0
    if holds.dof > 0:
        repeats = float(np.sqrt((away**2).mean() * len(away) / holds.dof / holds.count.mean()))
    theta = robot.robot_theta(model.configured(recording.metadata))
    sight = Sight(model, theta, holds.q, read, (), (), np.eye(3))
    position = sight._pose(holds.q, theta)[1]
    u, _, vt = np.linalg.svd((read - read.mean(axis=0)).T @ (position - position.mean(axis=0)))
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt  # Kabsch 1976
    columns, joints = _free(robot, np.ptp(sight.torque, axis=0), options)
    return replace(sight, turn=turn, columns=columns, joints=joints), repeats, len(places)


def _free(
    robot: Robot, loaded: np.ndarray, options: CalibrationOptions
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Indices of the free geometric parameters, and of joints with a free compliance; ``loaded``
    (J,) is the range of the weight's torque on each joint."""
    hidden = {p for p in robot.parameters.names if p.startswith(_HIDDEN)}
    places = [
        p for p in robot.parameters if p.name not in {*robot.load, *robot.unobservable, *hidden}
    ]
    bent = np.flatnonzero(loaded > _LOADED)
    give = [Parameter(f"{COMPLIANCE}{j + 1}", 0.0, "", 1.0) for j in bent]
    known = ParameterSet((*places, *give))
    chosen = set(known.select(options.free or known.names)) - set(known.select(options.hold))
    names = [known[k].name for k in sorted(chosen)]
    columns = tuple(robot.parameters.index(n) for n in names if not n.startswith(COMPLIANCE))
    joints = tuple(int(n.removeprefix(COMPLIANCE)) - 1 for n in names if n.startswith(COMPLIANCE))
    return columns, joints


def _held_out(sight: Sight, noise: float, tolerances: float, x: np.ndarray) -> tuple[float, float]:
    """Rms distance [m] of held-out poses from fits without them, and its expected value for a
    correct model, from noise [m] and number of poses (Cramér–Rao). Priors as in `Sight.solve`.

    Each fit is one Gauss–Newton step from that of all poses, x (K,), which is near.
    """
    order, scale = np.random.default_rng(0).permutation(len(sight.q)), sight.parameters.tolerance
    _, same = np.unique(sight.q.round(4), axis=0, return_inverse=True)
    fold = (order % FOLDS)[same.ravel()]  # visits of one pose are held out together
    slopes = sight.jacobian(x) * (scale / noise)
    residual = (sight.read - sight.expected(x)) / noise
    pull = np.diag(np.full(len(x), 1.0 / tolerances))
    short = (sight.start - x) / (scale * tolerances)
    square = allowed = 0.0
    for k in range(FOLDS):
        seen = fold != k
        design = np.concatenate([slopes[seen].reshape(-1, len(x)), pull])
        basis, triangle = np.linalg.qr(design)
        step = solve_triangular(triangle, basis.T @ np.append(residual[seen], short))
        away = residual[~seen] - slopes[~seen] @ step
        rows = slopes[~seen].reshape(-1, len(x))
        spread = solve_triangular(triangle, rows.T, trans="T")
        square += float((away**2).sum())
        allowed += away.size + float((spread**2).sum())
    return noise * float(np.sqrt(square / len(fold))), noise * float(np.sqrt(allowed / len(fold)))


def _identified(
    sight: Sight, solution: Solution, dof: float, tolerances: float
) -> tuple[IdentifiedValue, ...]:
    """Geometry and compliances with uncertainties (Student's t of ``dof``); None where the data add
    nothing to the prior of ``tolerances`` times a parameter's tolerance."""
    std = np.sqrt(np.diagonal(solution.covariance))
    determined = std < _TOLD * tolerances * sight.parameters.tolerance
    names = ((p.name, p.unit) for p in sight.parameters)
    wide, sure = float(special.stdtrit(dof, 0.975)), determined | (tolerances == 1.0)
    return identified_values(names, solution.x, std, sight.start, sure, wide)[: -len(_STAND)]
