"""What all drivers share: the contract, its data types, and the real-time part of live drivers.

May import: what ``hardware/drivers`` may import; no driver.
Read first: ``driver.py``; live drivers add ``live.py``, ``watched_move.py`` and ``timing.py``.
"""

from wrenchbed.hardware.drivers.base.driver import Driver
from wrenchbed.hardware.drivers.base.samples import Applied, ArmSample, Block, Move, Reached

__all__ = [
    "Applied",
    "ArmSample",
    "Block",
    "Driver",
    "Move",
    "Reached",
]
