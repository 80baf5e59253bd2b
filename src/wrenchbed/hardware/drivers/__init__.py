"""Drivers of robots, one file or folder each; `wrenchbed.registry.names("drivers")` lists them.

May import: transducers and device of this room, and what the room may import; no sibling driver.
Never: a vendor's library at import, or a move that the base did not check.
Read first: ``base.py``, then ``sim.py``; live drivers add ``live.py``.
Used by: campaigns, cli and monitoring.
"""

SUPPORT = ("live", "timing")
"""Modules of this folder that are no driver, beside ``base``."""
