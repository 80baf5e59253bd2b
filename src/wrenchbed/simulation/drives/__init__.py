"""Joint torques and motor currents of a simulated robot: rigid body by MuJoCo, drives as formulas.
Read first: `drive_train`, then `faults`.
Free: how a formula is computed; tests/drives holds the rigid torques against other formulas. Sizes
of noise and defaults decide benchmark figures: after a change make these anew (docs/explanation).
Others rely on: names of faults and drive parameters: ``--effect``, true values of stored cases.
Never: formulas of `drives` or `effects.drives`; what fits the data may not make them."""
