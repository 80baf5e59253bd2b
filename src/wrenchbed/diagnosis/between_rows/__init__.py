"""Effects that no mean shows: noise, coarse counts, repeats, vibration.
Imports prepare.
Read first: `row_effects`, then `scatter`.
Used by: `diagnose`.
"""
