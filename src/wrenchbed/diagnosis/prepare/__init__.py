"""A recording made ready: checks, noise, blocks, held-out rows, baseline calibration.
Read first: `prepared` (what all later steps work on), then `prepare_recording`.
Free: speed; tests/diagnosis/test_prepare and test_noise_in_motion check noise and splits. After a
change of a note or refusal run `scripts/messages`.
Others rely on: `Prepared`, folds of a seed, noise, every constant (tuned): after a change run
`scripts/learn_reliability`, then new sealed cases (docs/how-to/sealed.md).
Never: weigh evidence for an effect; here is only what every calibration fits.
"""
