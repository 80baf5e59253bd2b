"""Unmodelled effects: one file each, found by the folder; see `base`."""

SUPPORT = ("scene", "chain", "naming")
"""Modules here that are no plug-ins."""
