"""Drivers of robots, one file or folder each; `wrenchbed.registry.names("drivers")` lists them.

Free: the code inside one driver; tests/hardware/test_driver_contract.py tests them all. Not free:
`base` (campaigns, cli, monitoring call it); fields of options (`record` takes them: change
docs/how-to/hardware.md); keys of `ArmSample.extra_columns` (columns of docs/contracts.md);
`row_times.hermite`, along which CAN drives are commanded too (run test_can_setpoints.py).
Never: import a sibling driver or a vendor's library at import; move where the base did not check.
Read first: ``base.py``, then ``sim.py``; live drivers add ``live_base.py``.
"""

SUPPORT = ("live_base", "row_times")
"""Modules of this folder that are no driver, beside ``base``; `wrenchbed.registry` skips them."""
