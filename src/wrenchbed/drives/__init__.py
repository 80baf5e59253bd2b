"""Joint torques and motor currents: predicted and fitted.

Imports robots, data and what lies below. Open `inverse_dynamics` first. Used by: cli, diagnosis.
"""
