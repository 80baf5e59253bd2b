"""Driver of MedRUE over CAN: six CiA 402 drives and an ATI sensor on a NETCANOEM board, on one bus.

Free: the code inside functions; tests/hardware/test_can_safety.py, test_can_setpoints.py,
test_medrue_can.py and test_netcanoem_frames.py test it. Not free: the driver's name ``can`` and the
fields of `CanOptions` (taken by `record --set`: change docs/how-to/hardware.md), deadlines (run
scripts/reactions), objects and frames (the standards'). Never: the emulator's codec; both sides are
written from the standards. Read first: ``driver.py``, then ``cycle.py`` (the cyclic exchange) and
``drive_configuration.py`` (power-up); ``ati_gauge_board.py`` reads the sensor.
"""

from wrenchbed.hardware.drivers.can.driver import CanDriver
from wrenchbed.hardware.drivers.can.options import CanOptions

DRIVER = CanDriver

__all__ = ["DRIVER", "CanDriver", "CanOptions"]
