"""Drivers move a real or simulated robot; transducers read a force/torque sensor.

May import: simulation, twin, effects, calibration, robots, sensors, data, physics, registry.
Never: a codec of `robot_emulators`, nor a vendor's library at import.
Read first: ``device.py``, then ``drivers/base.py`` and ``transducers/base.py``.
Used by: campaigns, cli and monitoring.
"""
