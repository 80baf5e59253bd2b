"""Judges of the diagnosis: look-alike cases, the independent referee, sealed cases, scores.
May import: diagnosis and the rooms below it; `referee` and `lookalikes` use no effect or diagnosis.
Never: change a lesson or a commitment by hand; `scripts/learn_reliability` and `sealed` write them.
Read first: `scoring/metrics` (what is scored), then `sealed/make` and `referee/case`.
Used by: cli; its names in `wrenchbed`.
"""
