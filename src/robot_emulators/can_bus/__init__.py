"""A CAN bus between processes, with a model of the wire that the frames would travel on.
Imports: robot_emulators/base, errors.
Read first: hub.py.
"""
