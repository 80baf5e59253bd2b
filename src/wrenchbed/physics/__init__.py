"""Rotations, wrenches, gravity of an arm, sensor noise, parameters, Taylor arithmetic in time."""
