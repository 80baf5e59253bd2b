"""What is wrong with a robot of the fleet: its true parameters and the effect that it has."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from wrenchbed.chain import Active, acts, effects
from wrenchbed.effects.base import Variant
from wrenchbed.errors import ParameterError
from wrenchbed.fleet.setting import Fleet
from wrenchbed.jets import Jet
from wrenchbed.model import Model
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.scene import Scene

HEALTHY = 0.25
"""Share of robots without an effect, where effects vary."""
SIZES = (0.3, 6.0)
"""Sizes are drawn log-uniformly between these multiples of typical."""
_TRIES, _ROWS = 50, 24


@dataclass(frozen=True, eq=False)
class Truth:
    """One robot.

    Attributes:
        theta: true parameters (P,) of the model.
        active: its effect, if any.
        size: of that, in multiples of typical.
        values: parameters of that which are not nominal, SI.
    """

    theta: np.ndarray
    active: tuple[Active, ...] = ()
    size: float = 0.0
    values: Mapping[str, float] = field(default_factory=dict)

    @property
    def effect(self) -> str:
        """Name of the effect, empty if there is none."""
        return self.active[0].effect.name if self.active else ""


def varied(model: Model) -> tuple[int, ...]:
    """Parameters that differ from robot to robot: those that `calibrate` identifies."""
    return model.parameters.select(model.robot.free)


def draw(fleet: Fleet, k: int, model: Model, q: np.ndarray, mode: str) -> Truth:
    """Robot k: parameters uniform within their tolerances such that it reaches q (N, J).

    Raises:
        ParameterError: no robot within tolerance reaches them all.
    """
    robot = fleet.model_robot()
    theta = np.array(model.parameters.nominal)
    if "parameters" in fleet.vary:
        theta = _parameters(fleet.rng(k, "parameters"), model, robot, q)
    if "effects" not in fleet.vary:
        return Truth(theta)
    rng = fleet.rng(k, "effects")
    if rng.random() < HEALTHY:
        return Truth(theta)
    known = possible(fleet.robot, mode)
    name = list(known)[int(rng.integers(len(known)))]
    variants = known[name]
    weights = np.array([v.weight for v in variants])
    variant = variants[int(rng.choice(len(variants), p=weights / weights.sum()))]
    size = float(np.exp(rng.uniform(*np.log(SIZES))))
    effect = effects()[name]
    typical = effect.parameters(robot)
    values = {n: size * typical[typical.index(n)].tolerance for n in effect.usual(variant)}
    values |= {n: v for n, v in variant.at.items() if n not in values}
    return Truth(theta, (Active.of(robot, name, values),), size, values)


def _parameters(
    rng: np.random.Generator, model: Model, robot: SimulatedRobot, q: np.ndarray
) -> np.ndarray:
    columns, own = list(varied(model)), len(robot.parameters)
    tolerance = model.parameters.tolerance[columns]
    for _ in range(_TRIES):
        theta = np.array(model.parameters.nominal)
        theta[columns] += rng.uniform(-1.0, 1.0, len(columns)) * tolerance
        if not robot.infeasible(q, theta[:own]):
            return theta
    raise ParameterError(
        f"no {robot.name} within tolerance reaches all poses: plan poses further from its limits"
    )


@cache
def possible(name: str, mode: str) -> dict[str, tuple[Variant, ...]]:
    """Effects that a robot may have and their variants."""
    robot = Fleet(name, 1).model_robot()
    q = robot.sample(_ROWS, np.random.default_rng(0))
    moving = mode == "dynamic"
    at = np.ones(_ROWS, dtype=bool)
    scene = Scene(
        robot, robot.parameters.nominal, np.array(robot.gravity),
        Jet(q, 0.0 * q, 0.0 * q) if moving else q, 10.0 * np.arange(_ROWS), at,
    )  # fmt: skip
    found = {n: e.variants(scene) for n, e in effects().items() if acts(e, scene)}
    return {n: v for n, v in found.items() if v}
