"""What a driver is: it moves a robot and reads its sensor; a simulated robot is one like any other.

`Driver` owns the public methods and checks limits before anything moves; a device fills in the
methods with an underscore. `LiveDriver` adds what every real-time device shares.
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
