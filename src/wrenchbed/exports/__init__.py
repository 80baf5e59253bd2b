"""Files that carry a calibration to robot controllers, ROS 2, URDF and others; one file each.
May import: twin, simulation, robots and the rooms below them.
Never: fit; a number without its uncertainty is not written as known.
Read first: `base` (the contract), then `load_numbers` (what a fit or a twin knows, with its ±).
Used by: cli and monitoring.
"""

SUPPORT = ("load_numbers",)
"""Modules here that are no plug-ins."""
