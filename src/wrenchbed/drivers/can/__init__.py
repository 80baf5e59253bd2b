"""MedRUE over CAN: six CiA 402 drives and an ATI sensor on a NETCANOEM board, on one bus."""

from wrenchbed.drivers.can.driver import CanDriver
from wrenchbed.drivers.can.options import Options

DRIVER = CanDriver

__all__ = ["DRIVER", "CanDriver", "Options"]
