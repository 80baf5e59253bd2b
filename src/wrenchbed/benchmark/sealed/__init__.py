"""The sealed benchmark: cases whose truth is committed to, entrants that see them, and a score.
Free: the inside of each file (layout of the page); tests/benchmark/test_sealed_score.py checks.
Others rely on: files (docs/contracts.md); `Family`, `Entrant`, `make`, `run`, `score` (public);
that a seed makes the same family, against which published commitments are checked.
Never: show an entrant an answer, or change a case after its commitment.
Read first: `make`, then `run` and `score`.
"""
