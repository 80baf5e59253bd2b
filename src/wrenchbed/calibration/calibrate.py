"""Calibrate any robot from any recording: weighted least squares in the identifiable subspace.

Initial values come from one linear least squares: with known orientations a static reading is
linear in the mass m, the first moment h = m c and the six biases, and with independent channels the
normal equations are sums over gravity directions.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy import special

from wrenchbed import registry
from wrenchbed.calibration.checks.examine import REFUTED
from wrenchbed.calibration.checks.finding import Finding
from wrenchbed.calibration.checks.mistakes import WRENCH_TURNED, best_turn
from wrenchbed.calibration.checks.rigid_load import left_of_swing
from wrenchbed.calibration.checks.rows import of_rows
from wrenchbed.calibration.checks_before_fit import GENERAL, OUTLIERS, of_observations
from wrenchbed.calibration.fit import Fit, FitNoise, IdentifiedValue, identified_values
from wrenchbed.calibration.fit_problem import LOSSES, Outcome, Problem
from wrenchbed.calibration.least_squares import BLIND, Solution
from wrenchbed.calibration.misfit_uncertainty import Fault, allowed_for
from wrenchbed.calibration.observability import Observability
from wrenchbed.calibration.observations import FALLBACK_COVARIANCE, Observations, observe
from wrenchbed.calibration.position_error import Goal, tip_jacobian
from wrenchbed.calibration.subtracted_payload import restored
from wrenchbed.calibration.touch_points import Agreement, Touches
from wrenchbed.calibration.weighting import fit
from wrenchbed.data.metadata import ToolInfo
from wrenchbed.data.recording import POINT, QUATERNION, Recording
from wrenchbed.errors import CalibrationError
from wrenchbed.physics.taylor_jets import Jet
from wrenchbed.simulation.closed_form import Model, robot_of

_WELL_SPREAD = 1e-3
"""Least det N / (tr N / 3)³ of normal equations that Cramer's rule solves: it then loses three
digits of sixteen at most."""
_ENOUGH_ROWS = 500
CANDIDATES, DEFAULT = "candidates", "default"
"""Words of `CalibrationOptions.free`: what a robot may have wrong, and what it frees by default."""
_OTHER_MASS, _OTHER_CENTRE = 0.1, 0.02
"""Relative difference of a mass, and distance of a centre [m], from which a tool is another than is
stated: nobody weighs or measures worse."""
_NOISE = {"repeats": "the noise of the repeats", "stated": "the stated noise"}


@dataclass(frozen=True)
class IdentifiedLoad:
    """Fitted load: mass [kg], cog (3,) [m] in sensor axes; and the sensor's bias (6,) [N, N·m]."""

    mass: float
    cog: np.ndarray
    bias: np.ndarray


def identify_from_gravity(
    g: np.ndarray, wrench: np.ndarray, weight: np.ndarray | None = None
) -> IdentifiedLoad:
    """Fit mass, centre of gravity and bias to readings at rest, by weighted least squares.

    Args:
        g: gravity in sensor axes (N, 3) [m/s²].
        wrench: readings at rest (N, 6) [N, N·m].
        weight: inverse variance of each channel (6,), equal if None.

    Raises:
        CalibrationError: the orientations cannot separate mass from bias.
    """
    w = [1.0] * 6 if weight is None else weight.tolist()
    both = np.concatenate([g, wrench], axis=1)
    mean = np.add.reduce(both) / len(both)
    both -= mean  # the bias takes the means
    # sums of g gᵀ, g fᵀ and g τᵀ, a row a component of g
    x, y, z = (both[:, :3].T @ both).tolist()
    gx, gy, gz, *bias = mean.tolist()
    weighted_square = w[0] * x[0] + w[1] * y[1] + w[2] * z[2]
    square = x[0] + y[1] + z[2] + len(g) * (gx * gx + gy * gy + gz * gz)
    if not weighted_square > 1e-12 * square * max(w[:3]):
        raise CalibrationError(
            "all poses have one orientation: mass and bias cannot be distinguished"
        )
    mass = (w[0] * x[3] + w[1] * y[4] + w[2] * z[5]) / weighted_square
    hx, hy, hz = _moment(x, y, z, w[3:])
    for k, pull in enumerate((gx, gy, gz)):
        bias[k] -= mass * pull
    bias[3] -= hy * gz - hz * gy
    bias[4] -= hz * gx - hx * gz
    bias[5] -= hx * gy - hy * gx
    return IdentifiedLoad(mass, np.array([hx, hy, hz]) / mass, np.array(bias))


def _moment(x: list[float], y: list[float], z: list[float], w: list[float]) -> list[float]:
    """First moment h = m c (3,) [kg m] that best satisfies τ = h × g; of several the shortest.

    Args:
        x, y, z: of gx, gy, gz each: sums over rows of its products with g, f and τ, less means
            (9,).
        w: weights of the three torques (3,).
    """
    u, v, s = w
    a, b, c = v * z[2] + s * y[1], u * z[2] + s * x[0], u * y[1] + v * x[0]
    d, e, f = -s * x[1], -v * x[2], -u * y[2]  # N = [[a, d, e], [d, b, f], [e, f, c]]
    r = (s * y[8] - v * z[7], u * z[6] - s * x[8], v * x[7] - u * y[6])
    p, q, t = b * c - f * f, e * f - d * c, d * f - e * b
    determinant = a * p + d * q + e * t
    if not determinant > _WELL_SPREAD * ((a + b + c) / 3.0) ** 3:
        normal = np.array([[a, d, e], [d, b, f], [e, f, c]])
        minimal: list[float] = np.linalg.lstsq(normal, np.array(r), rcond=1e-10)[0].tolist()
        return minimal
    k, m, n = a * c - e * e, d * e - a * f, a * b - d * d
    return [
        (p * r[0] + q * r[1] + t * r[2]) / determinant,
        (q * r[0] + k * r[1] + m * r[2]) / determinant,
        (t * r[0] + m * r[1] + n * r[2]) / determinant,
    ]


def initial_values(
    model: Model, theta: np.ndarray, data: Observations, free: tuple[int, ...]
) -> np.ndarray:
    """Start of a fit (P,): theta, in which a linear fit to ``data`` at rest replaces mass, CoG and
    bias where ``free`` has their indices.

    Raises:
        CalibrationError: one orientation only, or a wrench of opposite sign.
    """
    robot, names = model.robot, {model.parameters.names[i] for i in free}
    if not {"sensor.bias.fx", "tool.mass"} <= names or isinstance(data.q, Jet):
        return theta
    seen = model.gravity_seen(data.q, theta)
    load = identify_from_gravity(seen, data.wrench)
    if load.mass <= 0 and {f"mount.rotation.{a}" for a in "xyz"} <= names:
        theta = _rotated_mount(model, theta, data, seen, load.mass)
        load = identify_from_gravity(model.gravity_seen(data.q, theta), data.wrench)
    else:
        check_mass(load.mass)
    tool = robot.theta_of_tool(robot.robot_theta(theta), load.mass, list(load.cog))
    known = np.concatenate([tool, load.bias, theta[len(tool) + len(load.bias) :]])
    start = theta.copy()
    start[list(free)] = known[list(free)]
    return start


def _rotated_mount(
    model: Model, theta: np.ndarray, data: Observations, g: np.ndarray, mass: float
) -> np.ndarray:
    """Parameters (P,) with the mount rotation that best aligns forces with gravity ``g`` (M, 3), or
    unchanged where only a mirror image would; then a ``mass`` [kg] not above 0 is an error."""
    from scipy.spatial.transform import Rotation  # slow to load: only when it is used

    turn = best_turn(g, data.wrench[:, :3])
    if turn is None:
        check_mass(mass)
        return theta
    names = [f"mount.rotation.{a}" for a in "xyz"]
    stated = Rotation.from_rotvec([theta[model.parameters.index(name)] for name in names])
    rotation = (stated * Rotation.from_matrix(turn)).as_rotvec()
    values = {name: float(v) for name, v in zip(names, rotation, strict=True)}
    return model.parameters.vector(values, start=theta)


def check_mass(mass: float) -> None:
    """Raise `CalibrationError` if a fitted mass [kg] is not above 0."""
    if not mass > 0:
        raise CalibrationError(WRENCH_TURNED.format(mass=mass))


@dataclass(frozen=True)
class CalibrationOptions:
    """Options of a calibration.

    Attributes:
        free: Parameters, groups (tool.cog) or patterns (L1?) to identify; `candidates` for all that
            the robot may have wrong, `default` or nothing for the robot's own choice.
        hold: Parameters, written as in ``free``, that keep their stated or nominal value.
        prior: Take each tolerance as a prior standard deviation.
        loss: Huber's resists outliers.
        force: Give the values also where the data refute them.
    """

    free: Sequence[str] = ()
    hold: Sequence[str] = ()
    prior: bool = False
    loss: Literal["linear", "huber"] = "linear"
    force: bool = False


def _without_unknown_joints(recording: Recording) -> Recording:
    """Drop the joints of a recording whose robot is unknown: the sensor's orientation remains."""
    known = registry.is_known("robots", recording.metadata.robot)
    if known or not recording.joints or QUATERNION[0] not in recording.columns:
        return recording
    kept = {k: v for k, v in recording.columns.items() if k not in recording.joints}
    return Recording(recording.metadata, kept, recording.name)


def calibrate(
    recording: Recording, options: CalibrationOptions | None = None, touches: Touches | None = None
) -> Fit:
    """Identify a robot's parameters from a recording; return them with their uncertainties.

    Weights come from the scatter of rows within each hold (a pose at rest), or from the stated
    noise; where the holds' means scatter more, from that scatter, and the uncertainties with them.
    ``touches`` of known points, made with the same robot, join the wrenches in one fit.

    Raises:
        RecordingError: the recording does not fit its robot.
        ParameterError: an unknown parameter.
        CalibrationError: too little data, one orientation only, a wrench of opposite sign; without
            ``options.force`` also data that refute the fit (see `checks`).
    """
    options = options or CalibrationOptions()
    recording = restored(_without_unknown_joints(recording))
    problem, finding = _checked(recording, options, touches)
    outcome = fit(problem)
    theta = problem.at(outcome.solution.x)
    check_mass(float(problem.model.robot.tool(problem.model.robot.robot_theta(theta)).mass))
    grown, fault = allowed_for(problem, outcome)
    fault = None if options.hold else fault  # a held number may be what is wrong
    refuted = _refuted(problem, outcome, finding, fault)
    if refuted is not None and not options.force:
        raise CalibrationError(f"{recording.name}: {refuted}")
    return replace(_result(recording, problem, grown, theta), refuted=refuted)


def _checked(
    recording: Recording, options: CalibrationOptions, touches: Touches | None
) -> tuple[Problem, Finding | None]:
    """Return a recording's fit problem and the finding, if any, despite which it may be fitted."""
    if options.loss not in LOSSES:
        raise CalibrationError(f"loss {options.loss!r} is not one of {', '.join(LOSSES)}")
    if POINT[0] in recording.columns:
        raise CalibrationError(
            f"{recording.name}: these are touches (columns px py pz), whose contact loads the "
            "sensor; give them as touches beside a recording under gravity"
        )
    robot = robot_of(recording)
    model = Model.of(robot, recording.metadata)
    finding = of_rows(recording)
    robust = options.loss != "linear"
    if finding and not (options.force or (robust and finding.reason in OUTLIERS)):
        raise CalibrationError(f"{recording.name}: {finding.sentence}")
    data = observe(recording)
    if recording.metadata.mode == "dynamic" and not recording.joints:
        raise CalibrationError(
            f"{recording.name}: motion needs joint columns; orientations give no acceleration. "
            "Calibrate a static recording"
        )
    free = _free(model, options)
    if touches is not None:
        if not robot.joints:
            raise CalibrationError(
                f"{recording.name}: has orientations only; touches need a robot's joints and tip"
            )
        robot.check(touches.q, robot.parameters.nominal, "touches")
    seen = data.wrench.size + (0 if touches is None else touches.points.size)
    if seen < len(free) and not options.prior:
        raise CalibrationError(
            f"{recording.name}: {len(data)} poses give {seen} readings, too few for "
            f"{len(free)} parameters"
        )
    stated = model.configured(recording.metadata)
    names = {model.parameters.names[i] for i in free}
    finding = finding or of_observations(recording, data, model, stated, names)
    # one orientation shows in the uncertainties or the fit; a robust loss resists outliers
    if finding and finding.reason in ("one orientation", *(OUTLIERS if robust else ())):
        finding = None
    if finding is not None and finding.reason not in GENERAL and not options.force:
        raise CalibrationError(f"{recording.name}: {finding.sentence}")
    theta = initial_values(model, stated, data, free)
    centre = stated[list(free)]
    problem = Problem(model, data, theta, free, centre, options.prior, options.loss, touches)
    return problem, finding


def left_by(fit: Fit, recording: Recording) -> tuple[Observations, np.ndarray]:
    """Observations that a fit used, and measured minus fitted wrench of each (M, 6) [N, N·m]."""
    recording = _without_unknown_joints(recording)
    model, data = Model.of(robot_of(recording), recording.metadata), observe(recording)
    theta = model.parameters.vector(dict(fit.theta))
    return data, data.wrench - model.predict(data.q, theta)


def _refuted(
    problem: Problem, outcome: Outcome, finding: Finding | None, fault: Fault | None
) -> str | None:
    """Why fitted values must not be used; None if they may be used. ``finding`` was made before the
    fit, ``fault`` is a large fault that explains its residual."""
    solution = outcome.solution
    if finding is not None and finding.reason not in GENERAL:
        return finding.sentence
    if fault is not None and (fault.moves or not solution.converged):
        return fault.sentence
    if not solution.converged:
        return (
            f"not converged after {solution.steps} steps: the data and the model do not fit "
            "together. Free fewer parameters, or check the robot and its joints"
        )
    unexplained = left_of_swing(problem.residual(solution.x), problem.data.wrench)
    if unexplained < REFUTED or (finding is None and problem.prior):
        return None
    if (named := fault or finding) is not None:
        return named.sentence
    return (
        f"the fit leaves {100.0 * unexplained:.0f} % of the readings' swing: the robot, its joints "
        "or the choice of free parameters is wrong. Look at the residual of each pose"
    )


def _free(model: Model, options: CalibrationOptions) -> tuple[int, ...]:
    groups = {CANDIDATES: model.robot.candidates, DEFAULT: model.robot.free}
    wanted = [n for w in options.free or (DEFAULT,) for n in groups.get(w, (w,))]
    chosen = model.parameters.select(wanted)
    held = set(model.parameters.select(options.hold)) if options.hold else set()
    free = tuple(i for i in chosen if i not in held)
    if not free:
        raise CalibrationError("no parameter is free")
    return free


def _result(recording: Recording, problem: Problem, outcome: Outcome, theta: np.ndarray) -> Fit:
    model, solution = problem.model, outcome.solution
    std = np.sqrt(np.diagonal(outcome.covariance))
    quantile = float(special.stdtrit(outcome.dof, 0.975)) if np.isfinite(outcome.dof) else 1.959964
    free, some = [model.parameters[i] for i in problem.free], list(problem.free)
    identified = identified_values(
        ((p.name, p.unit) for p in free), theta[some], std,
        model.configured(recording.metadata)[some], problem.prior | (solution.blind < BLIND),
        quantile,
    )  # fmt: skip
    tool = model.robot.tool(model.robot.robot_theta(theta))
    rms = np.sqrt(np.mean(problem.residual(solution.x) ** 2, axis=0))
    seats = problem.touches
    agreement = None if seats is None else seats.agreement(solution, problem.data.wrench.size)
    how = _status(solution, outcome.noise, identified, problem.data, agreement)
    unlike = _unlike_stated(recording.metadata.tool, float(tool.mass), np.asarray(tool.cog))
    return Fit(
        recording=recording.name,
        robot=recording.metadata.robot,
        status="; ".join((how, *unlike)),
        converged=solution.converged,
        iterations=solution.steps,
        identified=identified,
        theta=model.parameters.mapping(theta),
        gravity=model.gravity,
        tool={"mass": float(tool.mass), "cog": [float(c) for c in tool.cog]},
        covariance=outcome.covariance,
        residual_rms=rms,
        noise=outcome.noise,
        poses=len(problem.data),
        rows=int(problem.data.count.sum()),
        left_out=problem.data.left_out,
        observability=_observability(problem, theta),
        target_rms=_target_rms(problem, outcome, theta, agreement),
        touches=agreement,
    )


def _target_rms(
    problem: Problem, outcome: Outcome, theta: np.ndarray, agreement: Agreement | None
) -> float | None:
    robot = problem.model.robot
    target = robot.target() if problem.prior else None
    if target is None or (agreement is not None and agreement.doubtful):
        return None
    return Goal(tip_jacobian(robot, target, theta, problem.free)).rms(outcome.covariance)


def _observability(problem: Problem, theta: np.ndarray) -> Observability:
    model = problem.model
    names = model.parameters.names
    columns = tuple(sorted({*model.parameters.select(model.robot.candidates), *problem.free}))
    n = len(problem.data)
    some = np.sort(np.random.default_rng(0).permutation(n)[:_ENOUGH_ROWS])  # a rank needs no more
    jacobian = model.jacobian(problem.data.q[some], theta, columns)
    weight = 1.0 / np.sqrt(np.diagonal(FALLBACK_COVARIANCE))
    rows = (jacobian * weight[:, None]).reshape(-1, len(columns))
    if problem.touches is not None:
        rows = np.concatenate([rows, problem.touches.jacobian(model.robot, theta, columns)])
    return Observability(
        rows,
        [names[i] for i in columns],
        model.parameters.tolerance[list(columns)],
        model.robot.symmetries(model.robot.robot_theta(theta)),
    )


def _status(
    solution: Solution,
    noise: FitNoise,
    identified: Sequence[IdentifiedValue],
    data: Observations,
    agreement: Agreement | None,
) -> str:
    step = "step" if solution.steps == 1 else "steps"
    parts = [
        f"converged in {solution.steps} {step}"
        if solution.converged
        else f"not converged after {solution.steps} {step}: do not use these values"
    ]
    if noise.inflated:
        times = float(np.max(noise.scatter / np.maximum(noise.expected, 1e-300)))
        parts.append(
            f"the residual is up to {times:.1f} times what {_NOISE[noise.source]} explains (slow "
            "wander, or an effect that the model lacks); uncertainties follow the residual"
        )
    elif noise.source == "residual":
        parts.append("no repeats and no stated noise: uncertainties follow the residual")
    else:
        parts.append(f"the residual is what {_NOISE[noise.source]} explains")
    if agreement is not None and agreement.doubtful:
        parts.append(
            f"touch {agreement.worst} (counted from 0) lies {agreement.distance:.1f} standard "
            "deviations from where all else puts it: check its point, the robot and the touches' "
            "standard deviation before you use these values"
        )
    blind = [p.name for p in identified if p.std is None]
    if blind:
        parts.append(f"{len(blind)} parameters are fixed only in combination ({', '.join(blind)})")
    if data.left_out:
        parts.append(f"{data.left_out} saturated rows were left out")
    if data.flagged:
        parts.append(f"the sensor's status word is not 0 in {data.flagged} of the rows used")
    return "; ".join(parts)


def _unlike_stated(stated: ToolInfo, mass: float, cog: np.ndarray) -> Iterator[str]:
    """Yield sentences on a fitted mass [kg] and CoG (3,) [m] unlike those of ``stated``."""
    if stated.mass is not None and abs(mass / stated.mass - 1.0) > _OTHER_MASS:
        yield f"{stated.mass:.4g} kg is stated, the load is another"
    away = cog - np.asarray(cog if stated.cog is None else stated.cog)
    if float(np.linalg.norm(away)) > _OTHER_CENTRE:
        where = ", ".join(f"{1e3 * x:.0f}" for x in away)
        point = ", ".join(f"{x + 0.0:.4f}" for x in np.round(-away, 4))
        yield (
            f"the centre of gravity lies ({where}) mm from the stated one: another tool, or "
            f"torques about another point ([wrench] about = [{point}] in the column map)"
        )
