"""Transducer for ATI Net F/T: RDT over UDP, scaled by the box's web page.

Free: the inside of a file; tests/hardware/test_netft_parsers.py and test_netft_transducer.py test
it. Others rely on: the name ``netft`` and its address `FORM`; `at_address` (the UR driver and
doctor); names in ``sensor_box`` of metadata (docs/contracts.md). Never: the emulator's codec; both
sides are written from the manual. Read first: ``transducer.py`` (its web page too), then
``rdt.py``.
"""

from wrenchbed.hardware.transducers.netft.transducer import NetftOptions, NetftTransducer

TRANSDUCER = NetftTransducer

__all__ = ["TRANSDUCER", "NetftOptions", "NetftTransducer"]
