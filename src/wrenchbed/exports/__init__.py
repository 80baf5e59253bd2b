"""Files that carry a calibration to robot controllers, ROS 2, URDF and others; one file each.
Free: the inside of each file (comments in files); tests/exports/test_exports.py speaks.
Others rely on: formats of other programs (read `Export.source` before a text changes); names of
formats (``--to``), `load_numbers` and `calibrated_twin` are public: change docs/contracts.md,
docs/how-to/export.md and docs/reference/python.md with them.
Never: fit; a number without its uncertainty is not written as known.
Read first: `base` (the contract), then `load_numbers` (what a fit or a twin knows, with its ±)."""

SUPPORT = ("load_numbers",)
"""Modules here that are no plug-ins."""
