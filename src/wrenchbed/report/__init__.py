"""Reports: one HTML page that opens offline and needs nothing else."""

from wrenchbed.report.page import DiagnosisPage, diagnosis_page
from wrenchbed.report.recording_page import recording_page

__all__ = ["DiagnosisPage", "diagnosis_page", "recording_page"]
