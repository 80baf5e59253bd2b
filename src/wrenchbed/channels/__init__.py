"""Channels, one file each: what a sensor reads of the placed robot, and what is fitted away of it.
Read first: `base` (the contract), then `readings_with_effects` (how readings change with effects).
Free: how readings are computed and cached; tests/channels runs the contract on every channel.
Others rely on: names of columns: change docs/contracts.md with them. `floor` and sizes of ordinary
errors (`ZERO`, `LINK_MASS` …; in `drives` too) set a gap's unit: after a change run tests/drives
and `scripts/learn_reliability`.
Never: name a cause; what a channel fits away is nobody's fault.
"""

SUPPORT = ("readings_with_effects", "own_noise", "hierarchical_fit", "holding_torques")
"""Modules of this package that are no plug-ins."""
