"""Weighted least squares for a robot's parameters, and what the data can identify.
Read first: `calibrate`; then `fit_problem` (what is fitted), `weighting` (with which weights).
Free: the inside of functions. Constants are tuned: tests/calibration and `scripts/corruptions`
judge them.
Others rely on: fields of fit.json (change docs/contracts.md with them), sentences (run
`scripts/messages`), `Observations` and weights (then teach the diagnosis anew by
`scripts/learn_reliability`), `position_error` (run `scripts/studies`).
Never: MuJoCo, effects or a diagnosis; a fit to its own simulation proves nothing."""
