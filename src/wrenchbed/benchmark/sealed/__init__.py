"""The sealed benchmark: cases whose truth is committed to, entrants that see them, and a score.
Free: the inside of each file (layout of the page); tests/benchmark/test_sealed_score.py checks it.
Others rely on: names and forms of all files (docs/contracts.md), and that a seed makes the same
family: published commitments are checked against it.
Never: show an entrant an answer, or change a case after its commitment.
Read first: `make`, then `run` and `score`.
"""
