"""What a plan could show before it is recorded."""

from dataclasses import dataclass

from wrenchbed.diagnosis.baseline import tolerances
from wrenchbed.diagnosis.dictionary import build
from wrenchbed.diagnosis.isolability import Showing, cannot_tell, isolability
from wrenchbed.diagnosis.likeness import Likeness
from wrenchbed.diagnosis.one_thread import one_thread
from wrenchbed.diagnosis.rehearse import RATE, SAMPLES, of_plan
from wrenchbed.plan import Plan


@dataclass(frozen=True)
class DryRun:
    """Which effects a recording of a plan could show, and what it could not tell."""

    showings: tuple[Showing, ...]
    cannot_tell: tuple[str, ...]


@one_thread
def dry_run(plan: Plan, samples: int = SAMPLES, rate: float = RATE) -> DryRun:
    """Rehearse a plan on the nominal robot with its sensor's noise.

    Args:
        plan: poses or a motion.
        samples: rows a pose.
        rate: rows a second [Hz].

    Raises:
        DiagnosisError: such a recording could not be diagnosed, and why.
    """
    prepared = of_plan(plan, None, samples, rate)
    n = len(prepared.model.robot.parameters)
    mass = float(prepared.model.robot.tool(prepared.theta[:n]).mass)
    d = build(prepared, prepared.theta, tolerances(prepared, mass))
    likeness = Likeness(d)
    return DryRun(isolability(d, likeness), cannot_tell(d, likeness))
