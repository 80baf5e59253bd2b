"""Joint torques and motor currents of a simulated robot: rigid body by MuJoCo, drives as formulas.
Read first: `drive_train`, then `faults`.
Free: the inside of each file (sizes of noise); tests/drives holds the rigid torques against other
formulas.
Others rely on: names of faults and of drive parameters (``--effect``, true values of cases).
Never: formulas of `drives` or `effects.drives`; what fits the data may not make them."""
