"""Scores of a diagnosis and of simple baselines on cases whose truth is known.
Free: how figures are computed and ordered; tests/benchmark/test_scoring.py checks them.
Others rely on: names of figures and targets: change docs/sealed, docs/explanation/sealed.md with
them; fields of `Answer`: commitments of sealed families hash them, so raise `FORMAT`.
Never: decide; a verdict is taken as the diagnosis or an entrant gives it.
Read first: `metrics`, then `truth_and_claims`.
"""
