"""Families of the other worlds: look-alikes at several designs, and arms with measured efforts.

Their cases are written, answered and scored as those of the referee. An answer has no oracle.
"""

from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np

from wrenchbed import registry
from wrenchbed.benchmark.efforts import case as efforts
from wrenchbed.benchmark.lookalikes import ExperimentDesign, LookalikeCase, draw, recording
from wrenchbed.benchmark.sealed import commitments
from wrenchbed.benchmark.sealed.commitments import Answer, Fact
from wrenchbed.benchmark.sealed.make import Family
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import Recording
from wrenchbed.errors import ParameterError
from wrenchbed.planning import choose
from wrenchbed.robots.base import SimulatedRobot

POSES = (60, 100)
"""Fewest and most poses of a design at rest."""
SAMPLES, MOTION_S, RATE_HZ = 60, 60.0, 125.0
"""Rows of a pose; length of a motion [s] and its rate [Hz]."""
DESIGNS = {"static": 6, "dynamic": 3}
"""Number of designs over which the look-alikes of a mode are spread."""
_SEEDED = ("single", "none", "outside", "pair")
"""Kinds in the order that seeds of look-alikes follow from."""


@lru_cache(maxsize=8)
def design(robot: str, mode: str, seed: int, number: int) -> ExperimentDesign:
    """Random poses, or a multisine, with the robot's nominal numbers stated."""
    arm = registry.load("robots", robot)
    rng = np.random.default_rng([seed, 61, number])
    if mode == "dynamic":
        motion = choose.multisine(arm, MOTION_S, RATE_HZ, int(rng.integers(2**31)))
        return ExperimentDesign.of_plan(motion, arm)
    q = arm.sample(int(rng.integers(POSES[0], POSES[1] + 1)), rng)
    return ExperimentDesign.of_plan(Plan.of(robot, q), arm, samples=SAMPLES)


@dataclass(frozen=True)
class LookalikeFamily(Family):
    """Look-alikes, which the probabilities of the diagnosis are learnt on."""

    tries: ClassVar[int] = 8

    def about(self) -> dict[str, object]:
        """Contents of ``family.json``."""
        return {**asdict(self), "world": "look-alikes"}

    def drawn(self, index: int, attempt: int) -> tuple[ExperimentDesign, LookalikeCase]:
        """Design and look-alike of one case.

        Raises:
            ParameterError: this attempt finds none.
        """
        kinds = self.kinds()
        kind = kinds[index]
        number = kinds[:index].count(kind)
        rng = np.random.default_rng((self.seed, 60, _SEEDED.index(kind), number))
        first = int(rng.integers(2**40)) * self.tries  # room for draws that show nothing
        place = design(self.robot, self.mode, self.seed, number % DESIGNS[self.mode])
        return place, draw(place, first + attempt, kind)

    def case(self, index: int, attempt: int) -> tuple[Answer, Recording]:
        """Answer and recording of one case.

        Raises:
            ParameterError: this attempt finds none.
        """
        place, case = self.drawn(index, attempt)
        rows, name = recording(place, case), self.names()[index]
        facts = tuple(
            Fact(effect, None, gap, case.rows.get(effect, 0.0), case.true(effect), ())
            for effect, gap in case.gaps.items()
        )
        salt = commitments.salt(self.seed, name)
        return Answer(
            name, self.robot, self.mode, case.kind, facts, case.background, len(rows), None, salt
        ), rows


@dataclass(frozen=True)
class EffortFamily(Family):
    """Moving arms with torques or currents of their joints; several robots are joined by commas.

    Attributes:
        wrench: whether a force/torque sensor is read, too.
    """

    wrench: bool = False
    tries: ClassVar[int] = efforts.TRIES

    def about(self) -> dict[str, object]:
        """Contents of ``family.json``."""
        return {**asdict(self), "world": "efforts"}

    def check(self) -> None:
        """Refuse robots that cannot be simulated.

        Raises:
            ParameterError: one has no model.
        """
        assert self.robots()

    def robots(self) -> list[SimulatedRobot]:
        """The arms.

        Raises:
            ParameterError: one has no model.
        """
        arms = [registry.load("robots", name) for name in self.robot.split(",")]
        for arm in arms:
            if not isinstance(arm, SimulatedRobot):
                raise ParameterError(f"robot {arm.name!r} has no model to make cases with")
        return arms

    def kinds(self) -> list[str]:
        """Kind of each case."""
        return [efforts.kind_of(self.seed, k, self.wrench) for k in range(self.cases)]

    def case(self, index: int, attempt: int) -> tuple[Answer, Recording]:
        """Answer and recording of one case.

        Raises:
            ParameterError: this attempt finds none.
        """
        made = efforts.make(self.robots(), self.seed, index, self.wrench, attempt)
        name, fault = self.names()[index], made.fault
        facts: tuple[Fact, ...] = ()
        if made.kind != "none":
            effect = fault.name if made.kind == "outside" else efforts.name_of(made.alike[0])
            alike = tuple(map(efforts.name_of, made.alike[1:]))
            true = {k: float(v) for k, v in fault.true.items()}
            facts = (Fact(effect, None, made.gap, 0.0, true, alike),)
        salt = commitments.salt(self.seed, name)
        robot, rows = made.recording.metadata.robot, len(made.recording)
        return Answer(
            name, robot, self.mode, made.kind, facts, None, rows, None, salt
        ), made.recording
