"""HTML pages about a recording or a diagnosis, and the page of the effects.
May import: diagnosis, twin, calibration, pages and the rooms below them.
Read first: `recording_page`, then `page`; `sentences`, `tables` and `figures` fill a diagnosis.
"""

from wrenchbed.reports.page import DiagnosisPage, diagnosis_page
from wrenchbed.reports.recording_page import recording_page

__all__ = ["DiagnosisPage", "diagnosis_page", "recording_page"]
