"""Driver of UR robots over RTDE; ur_rtde commands in a process, because it can hang and crash.

Free: the inside of a file; tests/hardware/test_rtde_*.py and test_doctor.py test it.
Others rely on: the driver's name ``rtde``, fields of `RtdeOptions` (flags), `doctor` (cli), texts
of errors (docs/reference/messages.txt), metadata names in ``identity`` (docs/contracts.md).
Never: ur_rtde outside ``control_worker``, which imports the standard library only; the emulator's
codec. Read first: ``driver.py``, then ``connection.py``, ``states.py`` and ``control_worker.py``.
"""

from wrenchbed.hardware.drivers.rtde.connection import RtdeOptions
from wrenchbed.hardware.drivers.rtde.driver import RtdeDriver

DRIVER = RtdeDriver

__all__ = ["DRIVER", "RtdeDriver", "RtdeOptions"]
