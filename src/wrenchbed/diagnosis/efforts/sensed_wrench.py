"""What the sensor reads during a motion, and what it should read."""

import numpy as np

from wrenchbed.data.recording import Recording
from wrenchbed.errors import DiagnosisError
from wrenchbed.physics.time_derivatives import Jet
from wrenchbed.simulation.closed_form import Model


def measured(recording: Recording) -> np.ndarray:
    """Wrench (N, 6) [N, N·m].

    Raises:
        DiagnosisError: the recording has none.
    """
    if not recording.has_wrench:
        raise DiagnosisError(
            f"{recording.name}: has no wrench fx … tz: use --channels effort, which needs none"
        )
    return np.asarray(recording.wrench, dtype=float)


def predicted(
    model: Model, recording: Recording, theta: np.ndarray, q: Jet, gravity: np.ndarray
) -> np.ndarray:
    """Wrench (N, 6) [N, N·m] of a robot's parameters theta (P,) under gravity (3,) [m/s²]."""
    whole = model.configured(recording.metadata)
    whole[: len(theta)] = theta
    return Model(model.robot, tuple(float(g) for g in gravity)).predict(q, whole)
