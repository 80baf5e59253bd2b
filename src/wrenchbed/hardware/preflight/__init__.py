"""Devices looked at before a first session, without moving or setting anything.
May import: drivers, transducers, registry, robots, errors.
Read first: doctor.py.
"""
