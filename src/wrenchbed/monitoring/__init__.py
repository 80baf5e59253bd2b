"""A robot's numbers over time: what changed between two results.
May import: calibration, diagnosis and the rooms below them.
Read first: `compare`.
"""

from wrenchbed.monitoring.compare import Change, Comparison, compare

__all__ = ["Change", "Comparison", "compare"]
