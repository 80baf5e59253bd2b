"""Robots, one file or package each; `wrenchbed.registry.names("robots")` lists them."""

SUPPORT = ("mjcf", "model")
"""Modules here that are no plug-ins."""
