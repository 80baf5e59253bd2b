"""Settings of a campaign, and the true parameters of each of its robots.

Row k of a campaign is a function of the settings (`Fleet`) and of k alone.
"""

import hashlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.data.plan import Plan
from wrenchbed.errors import ParameterError
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.simulation.closed_form import Model

VARIED = ("noise", "parameters", "poses")
"""Properties that may differ from robot to robot."""
_STREAMS = {"noise": 0, "parameters": 1, "poses": 3}
"""Streams of random numbers by what is drawn from them; another one would make other robots."""
_TRIES = 50
"""Draws until a robot reaches all poses."""


@dataclass(frozen=True, eq=False)
class Fleet:
    """Many robots of one kind; row k follows from these and from k alone.

    Attributes:
        robot: registry name.
        robots: how many.
        vary: of `VARIED`; what does not vary is the same for all: the same noise, nominal
            parameters, the same poses.
        poses: of each, where no plan is given.
        samples: rows a pose.
        seed: not negative.
        plan: that all robots run.
    """

    robot: str
    robots: int
    vary: tuple[str, ...] = ("noise", "parameters")
    poses: int = 100
    samples: int = 50
    seed: int = 0
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
        return np.random.default_rng([self.seed, robot, _STREAMS[what]])

    def to_json(self) -> dict[str, Any]:
        """Settings that determine the rows, as JSON; the number of robots may grow later."""
        plan = None
        if self.plan is not None:
            plan = hashlib.sha256(np.ascontiguousarray(self.plan.q).tobytes()).hexdigest()
        return {
            "robot": self.robot, "vary": sorted(self.vary), "poses": self.poses,
            "samples": self.samples, "seed": self.seed, "plan": plan,
        }  # fmt: skip


def varied(model: Model) -> tuple[int, ...]:
    """Parameters that differ from robot to robot: those that `calibrate` identifies."""
    return model.parameters.select(model.robot.free)


def draw(fleet: Fleet, k: int, model: Model, q: np.ndarray) -> np.ndarray:
    """True parameters (P,) of robot k: uniform within tolerances such that it reaches q (N, J).

    Raises:
        ParameterError: no robot within tolerance reaches them all.
    """
    if "parameters" not in fleet.vary:
        return np.array(model.parameters.nominal)
    rng, robot = fleet.rng(k, "parameters"), fleet.model_robot()
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
