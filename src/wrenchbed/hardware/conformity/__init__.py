"""Does a CANopen drive keep to CiA 301 and CiA 402? Checks over the wire, with their evidence.

Nothing here knows an emulator; SDO transfers are made of raw frames. May import: errors, the link
of transducers. Read first: ``suite.py``, then ``bench.py``.
"""
