"""Joint torques and motor currents: predicted, fitted, and their gaps named.

Imports robots, data and what lies below. Open `inverse_dynamics` first.
"""
