"""What the whole study of MedRUE shares: pool, target, Jacobians, and the designs compared."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wrenchbed import registry
from wrenchbed.accuracy import Goal, tip_jacobian
from wrenchbed.model import Model
from wrenchbed.robots.medrue import workspace
from wrenchbed.robots.medrue.parameters import IDENTIFIED
from wrenchbed.robots.medrue.robot import MedRUE
from wrenchbed.selection.certificate import Certificate, certify, rounded
from wrenchbed.selection.criteria import INDICES, Criterion, i_optimality
from wrenchbed.selection.exchange import Pool, Selection, exchange
from wrenchbed.study.medrue.noise import PAPER

CONFIGURATIONS = 100
"""For identification, the paper's number."""
UNITS = {"m": 1e-3, "rad": np.pi / 180, "kg": 1.0}
"""The paper's table: mm, degrees, and kg (its g is a slip)."""

Tell = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Setting:
    """Everything at nominal parameters.

    Attributes:
        columns: positions of the 27 identified parameters.
        units: the paper's unit of each (27,) in SI.
        q: pool (N, 6).
        jacobian: of the wrench at the pool (N, 6, 27), SI.
        target: joint values (336, 6).
        goal: position in the target by the 27.
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
        """The Jacobian (N, 6, 27) in N and N·m per mm, degree and kg."""
        return self.jacobian * self.units

    def whitened(self, std: np.ndarray) -> np.ndarray:
        """The Jacobian (N, 6, 27) per standard deviation (6,) of the mean of a pose's samples."""
        return self.jacobian / std[:, None]

    def covariance(self, chosen: np.ndarray, std: np.ndarray) -> np.ndarray:
        """Cramér–Rao bound (27, 27): of any unbiased estimate from the chosen configurations."""
        rows = self.whitened(std)[chosen].reshape(-1, len(self.columns))
        scale = self.units
        triangle = np.linalg.inv(np.linalg.qr(rows * scale, mode="r"))
        return (triangle @ triangle.T) * np.outer(scale, scale)

    def bound(self, chosen: np.ndarray, std: np.ndarray) -> float:
        """The same as rms position error in the target [m]."""
        return self.goal.rms(self.covariance(chosen, std))


def prepare(
    n: int,
    seed: int,
    tilt: float = np.deg2rad(30.0),
    roll: float = np.deg2rad(60.0),
    orientations: int = workspace.ORIENTATIONS,
) -> Setting:
    """Pool of n configurations with tool orientations in `workspace.pool`'s ranges."""
    robot: MedRUE = registry.load("robots", "medrue")
    model = Model.of(robot)
    columns = model.parameters.select(IDENTIFIED)
    units = np.array([UNITS[model.parameters[c].unit] for c in columns])
    q = workspace.pool(robot, n, seed, tilt=tilt, roll=roll, orientations=orientations)
    theta = model.parameters.nominal
    target = workspace.target(robot)
    jacobian = model.jacobian(q, theta, columns)
    goal = Goal(tip_jacobian(robot, target, theta, columns))
    return Setting(robot, model, columns, units, q, jacobian, target, goal)


@dataclass(frozen=True, eq=False)
class Design:
    """100 chosen configurations and how near the best possible they are certified to be."""

    name: str
    chosen: np.ndarray
    value: float
    certificate: Certificate | None
    history: tuple[float, ...] = ()


def designs(setting: Setting, seed: int, starts: int, tell: Tell) -> dict[str, Design]:
    """By O1 … O5 in the paper's units, by the target's position error, and at random."""
    table = Pool(setting.in_table_units)
    result = {}
    for criterion in INDICES.values():
        result[criterion.name] = _best(table, criterion, seed, starts)
        tell(f"poses by {criterion.name}")
    scaled = Pool(setting.whitened(PAPER.std) * setting.units)
    weight = setting.goal.weight * np.outer(setting.units, setting.units)
    result["target"] = _best(scaled, i_optimality(weight), seed, starts, "target")
    tell("poses by target error")
    random = np.random.default_rng(seed).choice(len(setting.q), CONFIGURATIONS, replace=False)
    result["random"] = Design("random", np.sort(random), np.nan, None)
    return result


def _best(pool: Pool, criterion: Criterion, seed: int, starts: int, name: str = "") -> Design:
    found = [exchange(pool, criterion, CONFIGURATIONS, seed=seed + k) for k in range(starts)]
    best: Selection = max(found, key=lambda s: s.value)
    certificate = None
    if criterion.power is not None and criterion.smooth:
        certificate = certify(pool, criterion, CONFIGURATIONS, best.chosen)
        begin = rounded(certificate, CONFIGURATIONS)
        more = np.setdiff1d(best.chosen, begin)[: CONFIGURATIONS - len(begin)]
        polished = exchange(pool, criterion, CONFIGURATIONS, start=np.concatenate([begin, more]))
        best = max((best, polished), key=lambda s: s.value)
    return Design(name or criterion.name, best.chosen, best.value, certificate, found[0].history)
