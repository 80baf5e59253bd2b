"""What rerun shows of recordings, fits and diagnoses; the only part that knows rerun."""

from wrenchbed.viewer.calibrated import calibration_view
from wrenchbed.viewer.diagnosed import diagnosis_view
from wrenchbed.viewer.plans import plan_view
from wrenchbed.viewer.recordings import recording_view

__all__ = ["calibration_view", "diagnosis_view", "plan_view", "recording_view"]
