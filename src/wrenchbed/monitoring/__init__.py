"""A robot's numbers over time: what changed between two results, and the wrench live.
May import: exports, hardware, twin and the rooms below them.
Read first: `compare`, then `compensation` and `live`.
"""

from wrenchbed.monitoring.compare import Change, Comparison, compare

__all__ = ["Change", "Comparison", "compare"]
