"""Rotations, wrenches, gravity of an arm, sensor noise, parameters, Taylor arithmetic in time.
Imports no other room.
Never: MuJoCo, a file or a name of a robot; functions of arrays alone.
Read first: `wrench` (sign and axes), then `parameters` and `time_derivatives`.
Used by: every other room but files, jobs, pages and planning.
"""
