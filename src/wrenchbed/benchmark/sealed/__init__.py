"""The sealed benchmark: cases whose truth is committed to, entrants that see them, and a score.
Free: inner helpers and layout of the page; tests/benchmark/test_sealed_score.py checks.
Others rely on: files: change docs/contracts.md with them; `Family`, `Entrant`, `make`, `run`,
`score` are public; a seed must make the same bytes: docs/sealed has commitments to them.
Never: show an entrant an answer, or change a case after its commitment.
Read first: `make`, then `run` and `score`.
"""
