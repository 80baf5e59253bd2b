"""Robots, one file or package each; `wrenchbed.registry.names("robots")` lists them.
Imports physics only.
Read first: `base` (what a robot is), then `serial_arm` with `ur5` as its example.
"""

SUPPORT = ("mjcf", "motion_limits", "serial_arm")
"""Modules here that are no plug-ins."""
