"""Files that carry a calibration to robot controllers, ROS 2, URDF and others; one file each.
Free: the inside of each file (comments in files); tests/exports/test_exports.py speaks.
Others rely on: formats of other programs (each `Export.source`), names of formats (``--to``,
docs/contracts.md), `load_numbers` and `calibrated_twin` (cli, users).
Never: fit; a number without its uncertainty is not written as known.
Read first: `base` (the contract), then `load_numbers` (what a fit or a twin knows, with its ±)."""

SUPPORT = ("load_numbers",)
"""Modules here that are no plug-ins."""
