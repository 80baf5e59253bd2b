"""Identification of many random robots, by the paper's method and weighted by the noise.

Each robot's 27 identified parameters but the mass are drawn uniformly within ±2 mm and ±1°, as in
Section 5 of the paper. MuJoCo gives its wrenches, and in the target its wrenches and positions;
over the whole pool they come from the closed form, which agrees with MuJoCo to 1e-12.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from wrenchbed.calibration.least_squares import solve
from wrenchbed.calibration.position_error import statistics
from wrenchbed.jobs.finished_parts import Row
from wrenchbed.physics.wrench import wrench
from wrenchbed.planning.criteria import INDICES
from wrenchbed.simulation.mujoco_wrench import Simulation
from wrenchbed.studies import medrue_setting as published
from wrenchbed.studies.medrue_setting import LOWER, MINI40, PAPER, PoseDesign, StudySetting

_STOP = 1e-12
"""Rms change of parameters that ends a search [mm, °, kg]; the paper's 1e-16 is below rounding."""
_MOST = 30
"""Largest number of Newton steps."""
_NOISY_STOP = 1e-6
"""Rms change that ends a search on noisy readings [mm, °]: far below the error by noise; the steps
converge quadratically."""
STATISTICS = ("mean", "max", "std", "rms")

AGAIN = "O1 again"
"""Name of the case with the poses of index O1 and another draw of noise."""


@dataclass(frozen=True, eq=False)
class IdentifiedRobot:
    """Result of an identification: parameters (P,), and the number of Newton steps."""

    theta: np.ndarray
    steps: int


def as_the_paper(
    setting: StudySetting, q: np.ndarray, wrench: np.ndarray, stop: float = _STOP
) -> IdentifiedRobot:
    """Identify from measured means ``wrench`` (n, 6) [N, N·m] at q (n, 6), by unweighted normal
    equations with scaled columns: Section 4.2, Eqs. 24–30. It ends at an rms change ``stop`` of the
    parameters in the paper's units. NaN where it left the region in which the five-bar linkages
    close."""
    model, columns, units = setting.model, list(setting.columns), setting.units
    theta, change = setting.theta.copy(), np.inf
    for steps in range(_MOST):
        j = model.jacobian(q, theta, columns).reshape(-1, len(columns)) * units
        r = (wrench - model.predict(q, theta)).ravel()
        if not np.isfinite(j).all():
            return IdentifiedRobot(np.full_like(theta, np.nan), steps)
        scale = np.linalg.norm(j, axis=0)
        scaled = j / scale
        step = np.linalg.solve(scaled.T @ scaled, scaled.T @ r) / scale
        theta[columns] += step * units
        before, change = change, float(np.sqrt(np.mean(step**2)))
        if not change > stop or (steps > 2 and change > 0.5 * before):
            break  # done, at the floor of rounding, or lost
    return IdentifiedRobot(theta, steps + 1)


def weighted(
    setting: StudySetting,
    q: np.ndarray,
    wrench: np.ndarray,
    std: np.ndarray,
    start: np.ndarray | None = None,
) -> IdentifiedRobot:
    """Identify from mean wrenches (n, 6) at q (n, 6), each channel weighted by ``std`` (6,), its
    standard deviation of a mean; efficient for normal noise. Begins at nominal, or at ``start``
    (P,)."""
    model, columns = setting.model, list(setting.columns)

    def at(x: np.ndarray) -> np.ndarray:
        theta = setting.theta.copy()
        theta[columns] = x
        return theta

    solution = solve(
        lambda x: ((wrench - model.predict(q, at(x))) / std).ravel(),
        lambda x: (model.jacobian(q, at(x), columns) / std[:, None]).reshape(-1, len(columns)),
        (setting.theta if start is None else start)[columns],
        model.parameters.tolerance[columns],
    )
    return IdentifiedRobot(at(solution.x), solution.steps)


def of_table_1(setting: StudySetting, values: Mapping[str, float]) -> np.ndarray:
    """Robot parameters (P,) in SI, from ``values`` of Table 1 of the paper, `ACTUAL` or `NOISY`."""
    theta = setting.theta.copy()
    for c, unit in zip(setting.columns, setting.units, strict=True):
        theta[c] = values[setting.model.parameters.names[c]] * unit
    return theta


@dataclass(frozen=True, eq=False)
class PaperRobot:
    """The robot of Table 1, identified; position errors [m] in the target and over the pool.

    Attributes:
        theta: true parameters (P,).
        exact: identified without noise, by the paper's method.
        real: identified with the certificate's noise, by weighted least squares.
        errors: (case, workspace) → errors; cases are ``before``, ``exact``, ``real``, and each
            pose design with noise of ±1 N as 3σ, identified the paper's way.
        printed: rows of `Judge` for Table 1's column with measurement errors, and before.
    """

    theta: np.ndarray
    exact: IdentifiedRobot
    real: IdentifiedRobot
    errors: dict[str, dict[str, np.ndarray]]
    printed: list[Row]


def paper_robot(setting: StudySetting, designs: Mapping[str, PoseDesign], seed: int) -> PaperRobot:
    """Identify Table 1's robot: no noise, the certificate's, and each of ``designs`` at ±1 N."""
    theta = of_table_1(setting, published.ACTUAL)
    simulation = Simulation(setting.robot, setting.robot.robot_theta(theta))
    true = {"target": simulation.tip(setting.target), "whole": simulation.tip(setting.q)}
    rng = np.random.default_rng([seed, 10_000])

    def measured(name: str, noise: published.NoiseModel | None) -> tuple[np.ndarray, np.ndarray]:
        q = setting.q[designs[name].chosen]
        wrench = simulation.wrench(q)
        if noise is not None:
            wrench = wrench + rng.standard_normal(wrench.shape) * noise.std
        return q, wrench

    def errors(at: np.ndarray) -> dict[str, np.ndarray]:
        return {
            k: np.linalg.norm(predict(setting, q, at)[1] - true[k], axis=1)
            for k, q in (("target", setting.target), ("whole", setting.q))
        }

    exact = as_the_paper(setting, *measured("O1", None))
    real = weighted(setting, *measured("O1", MINI40), MINI40.std)
    thetas = {"before": setting.theta, "exact": exact.theta, "real": real.theta}
    for case, design in [*zip(INDICES, INDICES, strict=True), (AGAIN, "O1")]:
        thetas[case] = as_the_paper(setting, *measured(design, PAPER)).theta
    judge = Judge(setting, theta, simulation)
    rows = judge.rows(setting.theta, method="before")
    rows += judge.rows(of_table_1(setting, published.NOISY), method="printed")
    return PaperRobot(theta, exact, real, {k: errors(t) for k, t in thetas.items()}, rows)


def one_robot(shared: tuple[StudySetting, Mapping[str, np.ndarray], int], number: int) -> list[Row]:
    """Draw and identify a robot: rows of errors of the nominal model, of a fit without noise, and
    of fits by design, noise and method. ``number`` and the seed in ``shared`` give its parameters
    and noise; ``shared`` is (setting, design → indices (n,) of its configurations in the pool,
    seed)."""
    setting, designs, seed = shared
    rng = np.random.default_rng([seed, number])
    theta = setting.theta.copy()
    for c in setting.columns:
        parameter = setting.model.parameters[c]
        if parameter.unit != "kg":  # the mass stays nominal, as in Table 1
            theta[c] += rng.uniform(-parameter.tolerance, parameter.tolerance)
    simulation = Simulation(setting.robot, setting.robot.robot_theta(theta))
    judge = Judge(setting, theta, simulation)
    rows = judge.rows(setting.theta, robot=number, design="", noise="", method="before", steps=0)
    q = {name: setting.q[chosen] for name, chosen in designs.items()}
    exact = {name: simulation.wrench(each) for name, each in q.items()}
    robot = as_the_paper(setting, q["O1"], exact["O1"])
    rows += judge.rows(
        robot.theta, robot=number, design="O1", noise="none", method="paper", steps=robot.steps
    )
    for name in designs:
        for noise in (PAPER, MINI40, *LOWER) if name == "O1" else (PAPER,):
            measured = exact[name] + rng.standard_normal(exact[name].shape) * noise.std
            plain = as_the_paper(setting, q[name], measured, _NOISY_STOP)
            start = plain.theta if np.isfinite(plain.theta).all() else None
            best = weighted(setting, q[name], measured, noise.std, start)
            for method, one in (("paper", plain), ("weighted", best)):
                # over the whole pool only where a table asks for it
                whole = noise in (PAPER, MINI40) and (name == "O1" or method == "paper")
                labels = {"robot": number, "design": name, "noise": noise.name, "method": method}
                rows += judge.rows(one.theta, whole=whole, **labels, steps=one.steps)
    return rows


class Judge:
    """Errors of identified parameters: position, force, torque, in target workspace and pool."""

    def __init__(self, setting: StudySetting, theta: np.ndarray, simulation: Simulation) -> None:
        self.setting = setting
        self._whole = predict(setting, setting.q, theta)
        self._target = simulation.wrench(setting.target), simulation.tip(setting.target)

    def rows(self, theta: np.ndarray, *, whole: bool = True, **labels: object) -> list[Row]:
        """Errors of parameters (P,): a row with ``labels`` for each quantity in the target and, if
        ``whole``, the pool."""
        places = {"target": (self.setting.target, self._target)}
        if whole:
            places["whole"] = (self.setting.q, self._whole)
        rows = []
        for place, (q, (load, position)) in places.items():
            expected, there = predict(self.setting, q, theta)
            errors = {
                "position": np.linalg.norm(there - position, axis=1),
                "force": np.linalg.norm((expected - load)[:, :3], axis=1),
                "torque": np.linalg.norm((expected - load)[:, 3:], axis=1),
            }
            for quantity, values in errors.items():
                numbers = dict(zip(STATISTICS, map(float, statistics(values)), strict=True))
                rows.append({**labels, "workspace": place, "quantity": quantity, **numbers})
        return rows


def predict(
    setting: StudySetting, q: np.ndarray, theta: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Predict wrench (N, 6) [N, N·m] and tool position (N, 3) [m] at q (N, 6) in closed form."""
    robot, model = setting.robot, setting.model
    robot_theta = robot.robot_theta(theta)
    with np.errstate(invalid="ignore"):  # a bad estimate cannot reach every configuration
        rotation, origin = robot.sensor_pose(q, robot_theta)
        load = wrench(rotation, origin, robot.tool(robot_theta), np.asarray(model.gravity))
    p = robot.values(robot_theta)
    tip = np.array([p["xT"], p["yT"], p["zT"]])
    return model.read(load, theta), origin + rotation @ tip
