"""Files that carry a calibration to robot controllers, ROS 2, URDF and others; one file each.
May import: twin, simulation, robots and the rooms below them.
Read first: `base` (the contract), then `load_numbers` (what a fit or a twin knows, with its ±).
"""

from wrenchbed.exports.base import ExportOptions, export_to
from wrenchbed.exports.load_numbers import LoadNumbers, Origin, Quantity, load_numbers

__all__ = ["ExportOptions", "LoadNumbers", "Origin", "Quantity", "export_to", "load_numbers"]

SUPPORT = ("load_numbers",)
"""Modules here that are no plug-ins."""
