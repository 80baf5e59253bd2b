"""Transducer for ATI Net F/T: RDT over UDP, scaled by the box's web page.

Free: the code inside functions; tests/hardware/test_netft_parsers.py and test_netft_transducer.py
test it. Not free: the name ``netft`` and its address `FORM` (docs/how-to/hardware.md); `at_address`
(the UR driver and doctor call it); names in ``sensor_box`` of metadata (docs/contracts.md); limits
of silence and freezing (run scripts/reactions). Never: the emulator's codec; both sides are written
from the manual. Read first: ``transducer.py`` (its web page too), then ``rdt.py``.
"""

from wrenchbed.hardware.transducers.netft.transducer import NetftOptions, NetftTransducer

TRANSDUCER = NetftTransducer

__all__ = ["TRANSDUCER", "NetftOptions", "NetftTransducer"]
