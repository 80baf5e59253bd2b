"""Scores of a diagnosis and of simple baselines on cases whose truth is known.
May import: lookalikes, diagnosis, jobs and the rooms below them.
Never: decide; a verdict is taken as the diagnosis or an entrant gives it.
Read first: `metrics`, then `case_rows`.
Used by: sealed and cli.
"""
