"""Joint torques and motor currents: predicted and fitted.
Read first: `identify`; of poses at rest `at_rest`, of commands `servo`.
Free: the inside of each file; tests/drives recovers truths of other formulas.
Others rely on: names of groups and parameters, the fit's JSON (docs/contracts.md); usual errors,
which are its ± and what `diagnosis.efforts` takes for healthy (then sealed cases of efforts).
Never: formulas of `simulation.drives`; what makes the data may not fit them.
"""
