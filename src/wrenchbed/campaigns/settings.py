"""Settings of a campaign, and the true parameters and effect of each of its robots.

Row k of a campaign is a function of the settings (`Fleet`) and of k alone.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.data.plan import Plan
from wrenchbed.effects.base import Variant
from wrenchbed.effects.chain import ActiveEffect, effects
from wrenchbed.effects.scene import Scene
from wrenchbed.errors import ParameterError
from wrenchbed.physics.time_derivatives import Jet
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.simulation.closed_form import Model

VARIED = ("noise", "parameters", "effects", "poses")
"""Properties that may differ from robot to robot."""
HEALTHY = 0.25
"""Share of robots without an effect, where effects vary."""
SIZES = (0.3, 6.0)
"""Sizes are drawn log-uniformly between these multiples of typical."""
_TRIES, _ROWS = 50, 24
"""Draws until a robot reaches all poses, and poses at which effects are tested for an influence."""


@dataclass(frozen=True, eq=False)
class Fleet:
    """Many robots of one kind; row k follows from these and from k alone.

    Attributes:
        robot: registry name.
        robots: how many.
        vary: of `VARIED`; what does not vary is the same for all: the same noise, nominal
            parameters, no effect, the same poses.
        poses: of each, where no plan is given.
        samples: rows a pose.
        seed: not negative.
        diagnose: whether each recording is diagnosed, too.
        plan: that all robots run.
    """

    robot: str
    robots: int
    vary: tuple[str, ...] = ("noise", "parameters")
    poses: int = 100
    samples: int = 50
    seed: int = 0
    diagnose: bool = False
    plan: Plan | None = None

    def __post_init__(self) -> None:
        for what in self.vary:
            if what not in VARIED:
                raise ParameterError(f"--vary {what}: known are {', '.join(VARIED)}")
        for name in ("robots", "poses", "samples"):
            if getattr(self, name) < 1:
                raise ParameterError(f"--{name} {getattr(self, name)} must be at least 1")
        if self.seed < 0:
            raise ParameterError(f"seed {self.seed} must not be negative")
        if self.plan is not None:
            if "poses" in self.vary:
                raise ParameterError("--vary poses and --plan: a given plan is the same for all")
            if self.plan.robot != registry.known_as("robots", self.robot):
                raise ParameterError(
                    f"{self.plan.name}: the plan is for robot {self.plan.robot!r}, "
                    f"not {self.robot!r}"
                )
            if self.plan.points is not None:
                raise ParameterError(f"{self.plan.name}: holds touches; give a plan of poses")
        self.model_robot()

    def model_robot(self) -> SimulatedRobot:
        """The robot.

        Raises:
            ParameterError: it has no model that could be simulated.
        """
        robot = registry.load("robots", self.robot)
        if not isinstance(robot, SimulatedRobot):
            raise ParameterError(f"robot {self.robot!r} has no model to simulate")
        return robot

    def rng(self, k: int, what: str) -> np.random.Generator:
        """Random numbers of robot k for one of `VARIED`; the same for all if it does not vary."""
        robot = k + 1 if what in self.vary else 0
        return np.random.default_rng([self.seed, robot, VARIED.index(what)])

    def to_json(self) -> dict[str, Any]:
        """Settings that determine the rows, as JSON; the number of robots may grow later."""
        plan = None
        if self.plan is not None:
            plan = hashlib.sha256(np.ascontiguousarray(self.plan.q).tobytes()).hexdigest()
        return {
            "robot": self.robot, "vary": sorted(self.vary), "poses": self.poses,
            "samples": self.samples, "seed": self.seed, "diagnose": self.diagnose, "plan": plan,
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class Truth:
    """True parameters and effect of one robot.

    Attributes:
        theta: true parameters (P,) of the model.
        active: its effect, if any.
        size: of that, in multiples of typical.
        values: parameters of that which are not nominal, SI.
    """

    theta: np.ndarray
    active: tuple[ActiveEffect, ...] = ()
    size: float = 0.0
    values: Mapping[str, float] = field(default_factory=dict)

    @property
    def effect(self) -> str:
        """Name of the robot's effect, empty if there is none."""
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
    return Truth(theta, (ActiveEffect.of(robot, name, values),), size, values)


def _parameters(
    rng: np.random.Generator, model: Model, robot: SimulatedRobot, q: np.ndarray
) -> np.ndarray:
    columns, n_robot = list(varied(model)), len(robot.parameters)
    tolerance = model.parameters.tolerance[columns]
    for _ in range(_TRIES):
        theta = np.array(model.parameters.nominal)
        theta[columns] += rng.uniform(-1.0, 1.0, len(columns)) * tolerance
        if not robot.infeasible(q, theta[:n_robot]):
            return theta
    raise ParameterError(
        f"no {robot.name} within tolerance reaches all poses: plan poses further from its limits"
    )


@cache
def possible(name: str, mode: str) -> dict[str, tuple[Variant, ...]]:
    """Effects that change a reading of a robot, and their variants."""
    robot = Fleet(name, 1).model_robot()
    q = robot.sample(_ROWS, np.random.default_rng(0))
    moving = mode == "dynamic"
    at = np.ones(_ROWS, dtype=bool)
    scene = Scene(
        robot, robot.parameters.nominal, np.array(robot.gravity),
        Jet(q, 0.0 * q, 0.0 * q) if moving else q, 10.0 * np.arange(_ROWS), at,
    )  # fmt: skip
    variants = {n: e.variants(scene) for n, e in effects().items() if e.acts(scene)}
    return {n: v for n, v in variants.items() if v}
