"""MedRUE over CAN: six CiA 402 drives and an ATI sensor on a NETCANOEM board, on one bus."""

from wrenchbed.hardware.drivers.can.driver import CanDriver
from wrenchbed.hardware.drivers.can.options import CanOptions

DRIVER = CanDriver

__all__ = ["DRIVER", "CanDriver", "CanOptions"]
