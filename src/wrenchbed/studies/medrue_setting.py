"""Common data of the study of MedRUE: published figures, noise, pool, target, pose designs.

The paper is Joubair et al. 2016, doi 10.3390/s16060798.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wrenchbed import registry
from wrenchbed.calibration.position_error import Goal, statistics, tip_jacobian
from wrenchbed.planning.criteria import INDICES, Criterion, InverseTrace
from wrenchbed.planning.exchange import Pool, exchange
from wrenchbed.robots.medrue import inverse_kinematics
from wrenchbed.robots.medrue.kinematics import IDENTIFIED
from wrenchbed.robots.medrue.robot import MedRUE
from wrenchbed.simulation.closed_form import Model

TABLE_1 = {
    "A1z": (178.612, 178.659), "C1y": (-84.005, -84.002), "A2y": (-232.267, -232.294),
    "A2z": (177.325, 177.485), "C2z": (438.112, 438.210), "L11": (400.730, 400.742),
    "L12": (520.221, 520.321), "L13": (398.485, 398.502), "L14": (520.332, 520.271),
    "L21": (399.799, 399.774), "L22": (518.336, 518.505), "L24": (520.445, 520.460),
    "d41": (41.660, 41.657), "beta0": (0.525, 0.531), "gamma0": (-0.134, -0.176),
    "dq2": (0.313, 0.342), "dq3": (-0.052, -0.014), "dq4": (0.500, 0.529), "dq5": (0.135, 0.173),
    "dq6": (0.102, 0.097), "alphaS": (-67.397, -67.430), "betaS": (-0.525, -0.528),
    "gammaS": (0.185, 0.196), "xG": (0.576, 0.571), "yG": (0.059, 0.042), "zG": (153.132, 153.136),
    "mTool": (0.365, 0.365),
}  # fmt: skip
"""Parameters in the paper's Table 1 [mm, °, kg]: true ones of the simulated robot, and those
identified with measurement errors."""
ACTUAL, NOISY = ({name: pair[k] for name, pair in TABLE_1.items()} for k in range(2))
AFTER = {"mean": 0.2771, "max": 0.320, "std": 0.0157}
"""Position errors in the target after calibration [mm], as the abstract and Section 5 print."""
RMS_AFTER = float(np.hypot(AFTER["mean"], AFTER["std"]))
"""Root mean square position error [mm] that mean and std of `AFTER` imply."""
IMPROVEMENT = {
    ("force", "whole"): (99.43, 99.29, 99.34), ("torque", "whole"): (100.0, 99.43, 100.0),
    ("force", "target"): (98.31, 98.73, 99.24), ("torque", "target"): (96.36, 96.70, 100.0),
    ("position", "whole"): (96.79, 97.72, 98.57), ("position", "target"): (96.93, 97.38, 99.05),
}  # fmt: skip
"""Tables 2 and 3: improvement of mean, maximum and standard deviation [%]."""
T_STATISTIC = {("O1", "O2"): -655.874, ("O1", "O5"): -304.773, ("O2", "O5"): 421.3063}
"""Statistics of the t-tests in Table 5."""
ITERATIONS = 5
"""Number of the paper's Newton steps without noise."""
SAMPLES = 100
"""Measurements per configuration, which the paper may or may not average."""
STATED = np.array([1.0, 1.0, 1.0, 0.2, 0.2, 0.2])
"""Noise that the paper states [N, N·m]: ±1 N, ±0.2 N·m, Section 5."""
CERTIFICATE: np.ndarray = registry.load("sensors", "ati-mini40").accuracy
"""±0.25, 0.2, 0.45 N, ±0.0125, 0.0125, 0.02 N·m: the Mini40's certificate, Section 5."""
DRAWS = 4000
"""Number of random estimates from which expected errors are computed."""
CONFIGURATIONS = 100
"""Number of configurations for identification in the paper."""
UNITS = {"m": 1e-3, "rad": np.pi / 180, "kg": 1.0}
"""SI unit → the paper's unit in SI: mm, degrees, and kg (its g is a slip)."""


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """One interpretation of the paper's noise: its name for people, and the standard deviation (6,)
    [N, N·m] of one of the `SAMPLES` measurements that are averaged."""

    name: str
    row: np.ndarray

    @property
    def std(self) -> np.ndarray:
        """Standard deviation (6,) [N, N·m] of a configuration's mean of `SAMPLES` measurements."""
        return self.row / np.sqrt(SAMPLES)


PAPER = NoiseModel("±1 N as 3σ, 100 averaged", STATED / 3)
MINI40 = NoiseModel("certificate as 3σ, 100 averaged", CERTIFICATE / 3)
LOWER = tuple(
    NoiseModel(f"±{level:g} N as 3σ, 100 averaged", STATED * level / 3)
    for level in (0.5, 0.25, 0.1)
)
"""Lower noise levels for Table 6, torque in proportion; the paper's own levels are not in the text
that we have."""


@dataclass(frozen=True, eq=False)
class StudySetting:
    """Data that all parts of the study share, at nominal parameters: pool, target, Jacobians.

    Attributes:
        columns: indices of the 27 identified parameters among all.
        units: the paper's unit of each of the 27 parameters (27,), in SI.
        q: joint values of the pool (N, 6).
        jacobian: derivative of the wrench at the pool by the 27 parameters (N, 6, 27), SI.
        target: joint values in the target workspace (336, 6).
        goal: derivatives of the position in the target by the 27 parameters.
    """

    robot: MedRUE
    model: Model
    columns: tuple[int, ...]
    units: np.ndarray
    q: np.ndarray
    jacobian: np.ndarray
    target: np.ndarray
    goal: Goal

    @property
    def theta(self) -> np.ndarray:
        """Nominal parameters (P,)."""
        return self.model.parameters.nominal

    @property
    def in_table_units(self) -> np.ndarray:
        """Jacobian of the wrench (N, 6, 27) in N and N·m per mm, degree and kg."""
        return self.jacobian * self.units

    def covariance(self, chosen: np.ndarray, std: np.ndarray) -> np.ndarray:
        """Cramér–Rao bound (27, 27) at pool indices ``chosen`` (n,), noise ``std`` (6,) of a mean;
        SI."""
        rows = (self.in_table_units[chosen] / std[:, None]).reshape(-1, len(self.columns))
        triangle = np.linalg.inv(np.linalg.qr(rows, mode="r"))
        return (triangle @ triangle.T) * np.outer(self.units, self.units)

    def bound(self, chosen: np.ndarray, std: np.ndarray) -> float:
        """Cramér–Rao bound of the target's rms position error [m]: indices ``chosen``, noise
        ``std`` (6,)."""
        return self.goal.rms(self.covariance(chosen, std))

    def expected(self, chosen: np.ndarray, noise: NoiseModel) -> np.ndarray:
        """Mean, maximum, std, rms (4,) [m] of an efficient fit's error over the target; pool
        indices ``chosen``."""
        covariance = self.covariance(chosen, noise.std) / np.outer(self.units, self.units)
        draws = np.random.default_rng(0).standard_normal((DRAWS, len(covariance)))
        draws = draws @ np.linalg.cholesky(covariance).T * self.units
        return np.asarray(np.asarray(statistics(self.goal.errors(draws))).mean(axis=0))


def prepare(n: int, seed: int, orientations: int = inverse_kinematics.ORIENTATIONS) -> StudySetting:
    """Make the setting with a pool of n configurations, ``orientations`` at each position (see
    `inverse_kinematics.pool`)."""
    robot: MedRUE = registry.load("robots", "medrue")
    model = Model.of(robot)
    columns = model.parameters.select(IDENTIFIED)
    units = np.array([UNITS[model.parameters[c].unit] for c in columns])
    q = inverse_kinematics.pool(robot, n, seed, orientations=orientations)
    theta = model.parameters.nominal
    target = inverse_kinematics.target(robot)
    jacobian = model.jacobian(q, theta, columns)
    goal = Goal(tip_jacobian(robot, target, theta, columns))
    return StudySetting(robot, model, columns, units, q, jacobian, target, goal)


@dataclass(frozen=True, eq=False)
class PoseDesign:
    """100 chosen configurations, and the criterion after each exchange of the first search."""

    name: str
    chosen: np.ndarray
    value: float
    history: tuple[float, ...] = ()


def designs(
    setting: StudySetting, seed: int, starts: int, report: Callable[[str], None]
) -> dict[str, PoseDesign]:
    """Pose designs by indices O1 … O5 in the paper's units, by the position error in the target,
    and at random; ``starts``: random starts of each search, ``report``: called with a text after
    each."""
    table = Pool(setting.in_table_units)
    result = {}
    for criterion in INDICES.values():
        result[criterion.name] = _best(table, criterion, seed, starts)
        report(f"poses by {criterion.name}")
    scaled = Pool(setting.in_table_units / PAPER.std[:, None])
    weight = setting.goal.weight * np.outer(setting.units, setting.units)
    result["target"] = _best(scaled, InverseTrace(weight), seed, starts, "target")
    report("poses by target error")
    random = np.random.default_rng(seed).choice(len(setting.q), CONFIGURATIONS, replace=False)
    result["random"] = PoseDesign("random", np.sort(random), np.nan)
    return result


def _best(pool: Pool, criterion: Criterion, seed: int, starts: int, name: str = "") -> PoseDesign:
    runs = [exchange(pool, criterion, CONFIGURATIONS, seed=seed + k) for k in range(starts)]
    best = max(runs, key=lambda s: s.value)
    return PoseDesign(name or criterion.name, best.chosen, best.value, runs[0].history)
