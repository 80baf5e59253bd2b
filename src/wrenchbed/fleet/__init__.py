"""Campaigns of many simulated robots: what a calibration and a diagnosis are worth on average."""

from wrenchbed.fleet.running import run
from wrenchbed.fleet.setting import VARIED, Fleet

__all__ = ["VARIED", "Fleet", "run"]
