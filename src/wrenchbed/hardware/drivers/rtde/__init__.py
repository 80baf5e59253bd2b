"""Driver of UR robots over ur_rtde, which runs in worker processes because it can hang and crash.

May import: driver base, transducers; the workers import the standard library and shared_state only.
Read first: ``driver.py``, then ``connection.py``, ``state_worker.py`` and ``control_worker.py``.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from wrenchbed.hardware.drivers.rtde.connection import RtdeOptions
    from wrenchbed.hardware.drivers.rtde.driver import RtdeDriver

    DRIVER = RtdeDriver

_HOME = {"DRIVER": "driver", "RtdeDriver": "driver", "RtdeOptions": "connection"}

__all__ = ["DRIVER", "RtdeDriver", "RtdeOptions"]


def __getattr__(name: str) -> Any:
    """Names are imported on first use, so that the workers start quickly."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
