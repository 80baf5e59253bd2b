"""Transducer for ATI Net F/T: RDT over UDP, scaled by the box's web page.

May import: transducer base, ``hardware.device``, registry, physics, errors; no other transducer.
Never: the emulator's codec; both sides are written from the manual.
Read first: ``transducer.py`` (its web page too), then ``rdt.py``.
Used by: the registry, by the transducer's name ``netft``.
"""

from wrenchbed.hardware.transducers.netft.transducer import NetftOptions, NetftTransducer

TRANSDUCER = NetftTransducer

__all__ = ["TRANSDUCER", "NetftOptions", "NetftTransducer"]
