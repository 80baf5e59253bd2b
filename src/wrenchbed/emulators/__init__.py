"""Servers that speak the real robots' protocols, backed by MuJoCo; one folder a device.

What every twin shares: the robot in MuJoCo in real time, its sensor, timed faults, its life.
"""

SUPPORT = ("netft_box", "can_bus")
"""Modules here that are no plug-ins."""
