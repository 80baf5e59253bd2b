"""What a driver is: it moves a robot and reads its sensor; a simulated robot is one like any other.

`Driver` owns the public methods and checks limits before anything moves; a device fills in the
methods with an underscore. `LiveDriver` adds what every real-time device shares.
"""

from wrenchbed.drivers.base.driver import Driver
from wrenchbed.drivers.base.limits import Limits
from wrenchbed.drivers.base.motion import Motion, Reached
from wrenchbed.drivers.base.paths import (
    check_motion,
    duration,
    minimum_jerk,
    peak_speed,
    straight,
)
from wrenchbed.drivers.base.samples import Applied, ArmSample, Block

__all__ = [
    "Applied",
    "ArmSample",
    "Block",
    "Driver",
    "Limits",
    "Motion",
    "Reached",
    "check_motion",
    "duration",
    "minimum_jerk",
    "peak_speed",
    "straight",
]
