"""Transducers of force/torque sensors, one file or folder each.

Free: the code inside one transducer; tests/hardware/test_transducer_contract.py tests them all.
Not free: `base` (drivers call it); forms of addresses such as ``netft://HOST`` (docs/how-to/
hardware.md). Never: import a sibling or a driver; scale by a number that the device does not state.
Read first: ``base.py``, then ``netft/transducer.py``.
"""
