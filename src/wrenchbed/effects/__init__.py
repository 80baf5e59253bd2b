"""Unmodelled effects: one file each, found by the folder; see `base`."""
