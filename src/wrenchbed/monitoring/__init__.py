"""A robot's numbers over time: what changed between two results or in a history, the wrench live.
May import: exports, hardware, planning, twin and the rooms below them.
Never: a diagnosis; it says what changed, not why.
Read first: `compare`; then `check` (the monthly one), `history` (its file) and `steps` (its numbers
and their scatter), `compensation` and `live`.
Used by: cli.
"""
