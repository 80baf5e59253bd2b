"""Sensors on a serial line: the port, frames found in its bytes, and what such transducers share.

May import: transducer base, ``hardware.device``, errors; no plug-in.
Read first: ``framing.py``, then ``port.py`` and ``transducer.py``.
"""
