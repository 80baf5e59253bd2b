"""Drivers of robots, one file or folder each; `wrenchbed.registry.names("drivers")` lists them.

Free: the inside of one driver; tests/hardware/test_driver_contract.py speaks for all.
Others rely on: `base`, and names of options, which are flags of the command line.
Never: import a sibling driver or a vendor's library at import; move where the base did not check.
Read first: ``base.py``, then ``sim.py``; live drivers add ``live.py``.
"""

SUPPORT = ("live", "timing")
"""Modules of this folder that are no driver, beside ``base``."""
