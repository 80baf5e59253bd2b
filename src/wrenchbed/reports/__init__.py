"""HTML pages about a recording, a fit or a diagnosis, and the page of the effects.
May import: diagnosis, twin, calibration, pages and the rooms below them.
Read first: `recording_page`, `diagnosis_page`, then `sentences`, `tables` and `figures`.
"""

from wrenchbed.reports.diagnosis_page import ReportPage, diagnosis_page
from wrenchbed.reports.fit_page import fit_page
from wrenchbed.reports.recording_page import recording_page

__all__ = ["ReportPage", "diagnosis_page", "fit_page", "recording_page"]
