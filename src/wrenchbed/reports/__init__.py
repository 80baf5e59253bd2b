"""Reports: one HTML page that opens offline and needs nothing else."""

from wrenchbed.reports.page import DiagnosisPage, diagnosis_page
from wrenchbed.reports.recording_page import recording_page

__all__ = ["DiagnosisPage", "diagnosis_page", "recording_page"]
