"""Look-alike cases: robots with known faults, to test and to calibrate the diagnosis of real ones.

The physics here is written a second time, from the catalogue's words, and shares no code with the
library of effects: a diagnosis that is calibrated on its own effects would only confirm itself.
Turns are finite, hysteresis is Preisach's, loads come from finite differences of the pose, and
constants and exponents are jittered. Every case has small imperfections and untidy noise.
`faults` are of known effects, `faults_outside_library` of none.
Free: code that draws nothing (tests/benchmark/test_lookalikes.py).
Others rely on: names of draws: change `fault.EFFECTS` with them. Probabilities are learnt on these
cases: after a change of any law, size or order run `scripts/learn_reliability` (hours).
Never: import effects or the diagnosis; a test sees to it.
"""

from wrenchbed.benchmark.lookalikes.case import LookalikeCase, draw, effects, families, recording
from wrenchbed.benchmark.lookalikes.experiment_design import ExperimentDesign

__all__ = ["ExperimentDesign", "LookalikeCase", "draw", "effects", "families", "recording"]
