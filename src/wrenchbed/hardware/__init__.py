"""Drivers move a real or simulated robot; transducers read a force/torque sensor.

Free: the code inside the functions of a device, if tests/hardware pass (those marked ``wire`` run
against emulators). Not free: methods of `drivers.base` and `transducers.base` (change campaigns,
cli and monitoring with them), fields of options, which `record --set` takes (change docs/how-to/
hardware.md), columns and metadata of recordings (docs/contracts.md), `device_base.GONE_S` and
`live_base.CALM_SPEED` (monitoring uses them), texts of errors (run scripts/messages), times, limits
by which robots stop (run scripts/reactions; docs/how-to/hardware.md has their figures).
Never: a codec of `robot_emulators`, a vendor's library at import, a move that was not checked.
Read first: ``device_base.py``, then ``drivers/base.py`` and ``transducers/base.py``.
"""
