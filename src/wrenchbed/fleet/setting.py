"""What a campaign of many robots is: everything that its rows follow from."""

import hashlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.errors import ParameterError
from wrenchbed.plan import Plan
from wrenchbed.robots.base import SimulatedRobot

VARIED = ("noise", "parameters", "effects", "poses")
"""What may differ from robot to robot."""


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
            if self.plan.robot != self.robot:
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
        own = k + 1 if what in self.vary else 0
        return np.random.default_rng([self.seed, own, VARIED.index(what)])

    def told(self) -> dict[str, Any]:
        """What rows follow from, as JSON; the number of robots may grow later."""
        plan = None
        if self.plan is not None:
            plan = hashlib.sha256(np.ascontiguousarray(self.plan.q).tobytes()).hexdigest()
        return {
            "robot": self.robot, "vary": sorted(self.vary), "poses": self.poses,
            "samples": self.samples, "seed": self.seed, "diagnose": self.diagnose, "plan": plan,
        }  # fmt: skip
