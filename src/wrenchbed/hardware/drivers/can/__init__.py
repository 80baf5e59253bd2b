"""Driver of MedRUE over CAN: six CiA 402 drives and an ATI sensor on a NETCANOEM board, on one bus.

May import: driver base, transducer base, robots, registry, errors.
Never: the emulator's codec; both sides are written from the standards.
Read first: ``driver.py``, then ``cycle.py`` (the cyclic exchange) and ``network.py`` (power-up);
``board.py`` reads the sensor.
Used by: the registry, by the driver's name ``can``.
"""

from wrenchbed.hardware.drivers.can.driver import CanDriver
from wrenchbed.hardware.drivers.can.options import CanOptions

DRIVER = CanDriver

__all__ = ["DRIVER", "CanDriver", "CanOptions"]
