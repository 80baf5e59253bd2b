"""Effects that no mean shows: noise, coarse counts, repeats, vibration.
Imports prepare.
Never: a mean over rows as evidence; those are the other folders'.
Read first: `row_effects`, then `scatter`.
Used by: `diagnose`.
"""
