"""Joint torques and motor currents: predicted and fitted.

Imports channels, robots, data and what lies below. Open `identify` first, of poses at rest
`at_rest`. Used by: cli, diagnosis.
Never: formulas of `simulation.drives`; what makes the data may not fit them.
"""
