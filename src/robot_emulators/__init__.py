"""Emulators: servers that speak the real devices' protocols, with MuJoCo behind them; one a device.
Imports: twin, effects, simulation, robots, sensors, physics, data, registry, errors.
Read first: base/emulator.py, then the folder of a device, from its server.py.
"""

SUPPORT = ("netft_box", "can_bus", "canopen")
"""Modules here that are no plug-ins."""
