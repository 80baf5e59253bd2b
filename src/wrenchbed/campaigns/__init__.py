"""Campaigns of many simulated robots: what a calibration and a diagnosis are worth on average."""

from wrenchbed.campaigns.campaign import run
from wrenchbed.campaigns.setting import VARIED, Fleet

__all__ = ["VARIED", "Fleet", "run"]
