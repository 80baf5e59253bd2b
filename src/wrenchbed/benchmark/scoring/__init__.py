"""Scores of a diagnosis and of simple baselines on cases whose truth is known.
Free: the inside of each file (figures, their order); tests/benchmark/test_scoring.py checks it.
Others rely on: names of figures and targets, which docs/sealed and docs/explanation/sealed.md
print.
Never: decide; a verdict is taken as the diagnosis or an entrant gives it.
Read first: `metrics`, then `truth_and_claims`.
"""
