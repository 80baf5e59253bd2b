"""Transducers of force/torque sensors, one file or folder each.

May import: ``hardware.device``, registry, sensors, physics, errors; no sibling and no driver.
Never: scale by a number that the device does not state.
Read first: ``base.py``, then ``ur_wrench.py``, the shortest transducer.
Used by: drivers.
"""
