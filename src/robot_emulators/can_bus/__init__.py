"""A CAN bus between processes, and from there to a bus of python-can.
Imports: base, errors.
Read first: hub.py.
"""
