"""Transducers of force/torque sensors, one file or folder each.

Free: the inside of one transducer; tests/hardware/test_transducer_contract.py tests them all.
Others rely on: `base` (drivers), and the addresses of options such as ``netft://HOST``.
Never: import a sibling or a driver; scale by a number that the device does not state.
Read first: ``base.py``, then ``netft/transducer.py``.
"""
