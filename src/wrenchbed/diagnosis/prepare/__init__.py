"""A recording made ready: checks, noise, blocks, held-out rows, baseline calibration.
Imports no other folder of the diagnosis.
Never: evidence for an effect; what is fitted here every user fits.
Read first: `prepared` (what all later steps work on), then `prepare_recording`.
Used by: all folders of the diagnosis but efforts; benchmark, cli and reports.
"""
