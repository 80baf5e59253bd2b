"""Recordings, plans, fits and diagnoses as pictures for rerun; the only room that knows rerun.
May import: reports, diagnosis, campaigns (recording), twin, simulation and the rooms below them.
Read first: `view`, then `recordings`; `stream` is the canvas that everything is drawn on.
"""

from wrenchbed.viewer.calibrations import calibration_view
from wrenchbed.viewer.diagnoses import diagnosis_view
from wrenchbed.viewer.plans import plan_view
from wrenchbed.viewer.recordings import recording_view

__all__ = ["calibration_view", "diagnosis_view", "plan_view", "recording_view"]
