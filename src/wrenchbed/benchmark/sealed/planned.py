"""Cases that share one plan: a robot that nothing was learnt on is then learnt once for all."""

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np

from wrenchbed import registry
from wrenchbed.benchmark.lookalikes.design import STILL, ExperimentDesign
from wrenchbed.benchmark.referee import case as referee
from wrenchbed.benchmark.scoring.reliability_at_design import reliability_at_design
from wrenchbed.benchmark.sealed import commitments, make
from wrenchbed.benchmark.sealed.answer import Answer, of_case
from wrenchbed.benchmark.sealed.entrants import OURS, Entrant
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import Recording
from wrenchbed.errors import ParameterError
from wrenchbed.jobs.workers import Progress, silent


@dataclass(frozen=True)
class PlannedFamily(make.Family):
    """Cases at the poses of a plan; stated tool, path and weather are the same for all.

    Attributes:
        plan: SHA-256 of its file.
        poses: (H, J) [rad or m].
    """

    plan: str = ""
    poses: np.ndarray = field(default_factory=lambda: np.empty((0, 0)), compare=False)

    @classmethod
    def at(cls, source: Path, robot: str, cases: int, seed: int) -> "PlannedFamily":
        """A family at a plan's poses.

        Raises:
            PlanError: the file is no plan, or the robot cannot take its poses.
            ParameterError: the plan is of another robot, or a motion.
        """
        plan = Plan.read(source)
        name = registry.known_as("robots", robot)
        if plan.robot != name:
            raise ParameterError(f"{source}: is a plan for {plan.robot!r}, not for {name!r}")
        if plan.mode != "static":
            raise ParameterError(f"{source}: is a motion; cases share the poses of a plan only")
        arm = registry.load("robots", robot)
        arm.check(plan.q, arm.parameters.nominal, str(source))
        digest = commitments.digest(source.read_bytes())
        return cls(robot, "static", cases, seed, digest, plan.q)

    def about(self) -> dict[str, object]:
        """Without the poses, which the plan's SHA-256 stands for."""
        return {k: v for k, v in asdict(self).items() if k != "poses"}

    def case(self, index: int, attempt: int) -> tuple[Answer, Recording]:
        """One case.

        Raises:
            ParameterError: this attempt finds none.
        """
        kind, name = self.kinds()[index], self.names()[index]
        seed = (self.seed, index, attempt)
        case = referee.make(self.robot, self.mode, kind, seed, self.poses)
        return of_case(case, name, commitments.salt(self.seed, name)), case.recording


def taught(
    entrants: list[Entrant],
    cases: Path,
    count: int,
    processes: int = 2,
    report: Progress = silent,
) -> list[Entrant]:
    """Entrants of which the diagnosis has learnt from look-alikes of the cases' common design.

    Args:
        cases: folder of recordings and commitments.
        count: look-alikes; those of this design that are kept are not made again.
        report: called with the number of further look-alikes that are done.

    Raises:
        ParameterError: the cases have no common design.
        DiagnosisError: too few look-alikes.
    """
    paths = [commitments.recording_of(cases, name) for name in sorted(commitments.read(cases))]
    first = Recording.read(paths[0])
    common = ExperimentDesign.of(first)
    for path in paths[1:]:
        if not _same(common, ExperimentDesign.of(Recording.read(path))):
            raise ParameterError(
                f"{path}: its poses or its stated numbers are not those of {paths[0].name}: "
                "--look-alikes needs cases of one plan (wrenchbed blind make --plan)"
            )
    known = reliability_at_design(first, count, processes=processes, report=report)
    return [replace(e, learnt=known) if e.name == OURS else e for e in entrants]


def _same(one: ExperimentDesign, other: ExperimentDesign) -> bool:
    stated = one.metadata.to_json() == other.metadata.to_json()
    return stated and one.q.shape == other.q.shape and np.allclose(one.q, other.q, 0.0, STILL)
