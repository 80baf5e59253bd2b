"""A CAN bus between processes, with a model of the wire that the frames would travel on.
Imports: emulators/base, registry, errors.
Read first: hub.py.
"""
