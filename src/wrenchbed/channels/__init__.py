"""Channels, one file each: what a sensor reads of the placed robot, and what is fitted away of it.
Read first: `base` (the contract), then `response` (how readings change with effects).
Free: the inside of each file (how readings are computed and cached); tests/channels runs the
contract on every channel.
Others rely on: names of columns (docs/contracts.md); floors and usual sizes, a gap's unit in
diagnosis (`ZERO`, `LINK_MASS` … in `drives` too): after a change `scripts/learn_reliability`.
Never: name a cause; what a channel fits away is nobody's fault.
"""

SUPPORT = ("response", "own_noise", "posterior", "holding_torques")
"""Modules of this package that are no plug-ins."""
