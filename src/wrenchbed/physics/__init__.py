"""Rotations, wrenches, gravity of an arm, sensor noise, parameters, Taylor arithmetic in time.
Imports no other room.
Read first: `wrench` (sign and axes), then `parameters` and `time_derivatives`.
Used by: every other room but files, jobs, pages and planning.
"""
