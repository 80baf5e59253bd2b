"""Robots, one file or package each; `wrenchbed.registry.names("robots")` lists them."""

SUPPORT = ("mjcf", "motion_limits")
"""Modules here that are no plug-ins."""
