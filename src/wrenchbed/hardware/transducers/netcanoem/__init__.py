"""Transducer for an ATI Mini40, or another ATI gauge sensor, on a NETCANOEM board over CAN.

May import: transducer base, ``hardware.device``, registry, errors; no other transducer.
Read first: ``transducer.py``, then ``frames.py`` (protocol) and ``link.py`` (the bus).
"""

from wrenchbed.hardware.transducers.netcanoem.transducer import (
    NetcanoemOptions,
    NetcanoemTransducer,
)

TRANSDUCER = NetcanoemTransducer

__all__ = ["TRANSDUCER", "NetcanoemOptions", "NetcanoemTransducer"]
