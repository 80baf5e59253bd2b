"""Drivers of robots, one file or folder each; `wrenchbed.registry.names("drivers")` lists them.

Free: the inside of one driver; tests/hardware/test_driver_contract.py tests them all.
Others rely on: `base`; names of options, which are flags of the command line; keys of
`ArmSample.extra_columns`, which are columns of docs/contracts.md; `timing.hermite`, along which CAN
drives are commanded too.
Never: import a sibling driver or a vendor's library at import; move where the base did not check.
Read first: ``base.py``, then ``sim.py``; live drivers add ``live.py``.
"""

SUPPORT = ("live", "timing")
"""Modules of this folder that are no driver, beside ``base``; `wrenchbed.registry` skips them."""
