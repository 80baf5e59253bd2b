"""Joint torques and motor currents: predicted and fitted. Read first: `identify`; for poses at rest
`identify_at_rest`, for servo commands `servo`. Free: numerics; tests/drives recovers truths.
Others rely on: `wrenchbed` exports `calibrate_…`, `DriveFit`: change docs/reference/python.md with
them. `GROUPS` are words of `--free`, names and JSON: change docs/contracts.md. After a change of
`FOLDS` or a usual error run tests/diagnosis/efforts and score sealed cases of efforts anew.
Never: use formulas of `simulation.drives`; what makes the data may not fit them.
"""
