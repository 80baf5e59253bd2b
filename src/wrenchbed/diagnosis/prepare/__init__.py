"""A recording made ready: checks, noise, blocks, held-out rows, baseline calibration.
Read first: `prepared` (what all later steps work on), then `prepare_recording`.
Free: speed, notes; tests/diagnosis/test_prepare and test_noise_in_motion check noise and splits.
Others rely on: `Prepared`, folds of a seed, noise: after a change `scripts/learn_reliability`.
Never: weigh evidence for an effect; here is only what every calibration fits.
"""
