"""Driver of UR robots over RTDE; ur_rtde commands in a process, because it can hang and crash.

May import: driver base, transducers; ``control_worker`` imports the standard library only.
Never: ur_rtde outside ``control_worker``, or the emulator's codec.
Read first: ``driver.py``, then ``connection.py``, ``states.py`` and ``control_worker.py``.
Used by: the registry, by the driver's name ``rtde``; cli, for its doctor.
"""

from wrenchbed.hardware.drivers.rtde.connection import RtdeOptions
from wrenchbed.hardware.drivers.rtde.driver import RtdeDriver

DRIVER = RtdeDriver

__all__ = ["DRIVER", "RtdeDriver", "RtdeOptions"]
