"""Checks before a diagnosis: `enough` refuses what no method could diagnose.

The checks are those of a calibration. A diagnosis refuses only recordings that nothing can be
learnt from; it may set aside or name contacts, another tool or a jump of the zero.
"""

from wrenchbed.calibration.checks.examine import examine
from wrenchbed.calibration.checks_before_fit import observed
from wrenchbed.calibration.observations import Observations
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.prepare.configured_simulator import Configuration
from wrenchbed.errors import DiagnosisError

LEAST_POSES = 12
"""Fewest poses: their 72 readings determine bias, mass and CoG, and leave blocks to hold out."""
LEAST_SECONDS = 5.0
"""Shortest motion of a diagnosis [s]: a shorter one leaves held-out blocks without motion."""


def enough(recording: Recording, data: Observations, configuration: Configuration) -> None:
    """Raise if no method could diagnose a recording.

    Raises:
        DiagnosisError: too few poses, one orientation, a channel that is dead, stuck or saturated,
            or readings that do not follow a tool's weight on this robot.
    """
    name, moving = recording.name, recording.metadata.mode == "dynamic"
    if not moving and len(data) < LEAST_POSES:
        raise DiagnosisError(
            f"{name}: {len(data)} poses cannot separate causes; record at least {LEAST_POSES}, "
            "better 60, in varied orientations"
        )
    if moving and recording.t[-1] - recording.t[0] < LEAST_SECONDS:
        raise DiagnosisError(f"{name}: less than {LEAST_SECONDS:g} s of motion; record 60 s")
    if not recording.has_wrench:
        return
    model = configuration.model
    free = {model.parameters.names[i] for i in model.parameters.select(model.robot.free)}
    seen = observed(recording, data, model, configuration.theta, free)
    finding = examine(recording, seen, blocking=True)
    if finding is not None:
        raise DiagnosisError(f"{name}: {finding.sentence}")
