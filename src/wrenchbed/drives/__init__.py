"""Joint torques and motor currents: predicted and fitted.
Read first: `identify`; for poses at rest `at_rest`, for servo commands `servo`.
Free: the inside of each file; tests/drives recovers truths of other formulas.
Others rely on: `wrenchbed` exports `calibrate_…`, `DriveFit`; groups are `--free`; names and JSON
are in docs/contracts.md; `FOLDS`, usual errors: tests/diagnosis/efforts, sealed cases of efforts.
Never: use formulas of `simulation.drives`; what makes the data may not fit them.
"""
