"""Channels, one file each: what a sensor reads of the placed robot, and what is fitted away of it.
Imports data, effects, physics and registry; never a diagnosis.
Never: name a cause; what a channel fits away is nobody's fault.
Read first: `base` (the contract), then `response` (how readings change with effects).
Used by: diagnosis, drives, monitoring.
"""

SUPPORT = ("response", "own_noise", "posterior", "held")
"""Modules of this package that are no plug-ins."""
