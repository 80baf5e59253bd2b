"""A CAN bus between processes, as a server of socketcand.
Imports: base, errors.
Read first: hub.py.
"""
