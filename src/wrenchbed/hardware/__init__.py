"""Drivers move a real or simulated robot; transducers read a force/torque sensor.

Free: the inside of a device; tests/hardware test it (those marked ``wire`` against emulators).
Others rely on: the contracts `drivers.base` and `transducers.base` (campaigns, cli, monitoring),
names of options (the command line's flags), columns and metadata of recordings (docs/contracts.md),
`device.GONE_S` and `live.CALM_SPEED` (monitoring). After a change of an error's text run
scripts/messages; scripts/reactions measures what drivers do after faults.
Never: a codec of `robot_emulators`, a vendor's library at import, a move that was not checked.
Read first: ``device.py``, then ``drivers/base.py`` and ``transducers/base.py``.
"""
