"""Joint torques and motor currents of a simulated robot: rigid body by MuJoCo, drives as formulas.

Imports simulation, robots and what lies below. Read first: `drive_train`, then `faults`. The fits
of `wrenchbed.drives` have formulas of their own.
Never: formulas of `drives` or `effects`; what fits the data may not make them.
Used by: hardware and plant.
"""
