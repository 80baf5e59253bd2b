"""The sealed benchmark: cases whose truth is committed to, entrants that see them, and a score.
May import: referee, lookalikes, efforts, scoring, diagnosis and the rooms below them.
Never: show an entrant an answer, or change a case after its commitment.
Read first: `make`, then `run` and `score`.
Used by: cli.
"""
