"""Weighted least squares for a robot's parameters, and what the data can identify.
Read first: `calibrate`; then `fit_problem` (what is fitted), `weighting` (with which weights).
Free: the inside of each file (search, weights, thresholds); tests/calibration and
`scripts/corruptions` judge them.
Others rely on: fit.json (docs/contracts.md), sentences (run `scripts/messages`), `Observations`,
with which the probabilities of a diagnosis were learnt (`scripts/learn_reliability`).
Never: MuJoCo, effects or a diagnosis; a fit to its own simulation proves nothing."""
