"""Driver of UR robots over RTDE; ur_rtde commands in a process, because it can hang and crash.

Free: the code inside functions; tests/hardware/test_rtde_*.py and test_doctor.py test it. Not free:
the driver's name ``rtde`` and fields of `RtdeOptions` (taken by `record --set`: change docs/how-to/
hardware.md), fields of `doctor.Line` and metadata names in ``identity`` (docs/contracts.md), texts
of errors (run scripts/messages), deadlines (run scripts/reactions). Never: ur_rtde outside
``control_worker``, which imports the standard library only; the emulator's codec.
Read first: ``driver.py``, then ``connection.py``, ``states.py`` and ``control_worker.py``.
"""

from wrenchbed.hardware.drivers.rtde.connection import RtdeOptions
from wrenchbed.hardware.drivers.rtde.driver import RtdeDriver

DRIVER = RtdeDriver

__all__ = ["DRIVER", "RtdeDriver", "RtdeOptions"]
