"""Reports: one HTML page that opens offline and needs nothing else."""

from wrenchbed.report.page import Page, diagnosis_page
from wrenchbed.report.recorded import recording_page

__all__ = ["Page", "diagnosis_page", "recording_page"]
