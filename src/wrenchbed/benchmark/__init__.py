"""Judges of the diagnosis: look-alike cases, the independent referee, sealed cases, scores.
Free: code that changes no reading of a seed and writes no file; tests/benchmark checks it.
Others rely on: names in `fault.EFFECTS`: change them with the effect. Draws (also their order):
a change makes other cases of a seed, so make docs/explanation/benchmark.md anew, for `lookalikes`
after `scripts/learn_reliability`. Files of `sealed`: change docs/contracts.md with them; keys of
an `arena` catalogue: docs/how-to/arena.md.
Never: import effects or the diagnosis into `referee`, `lookalikes` or `efforts` (a test); change a
lesson or a commitment by hand. Read first: `scoring/metrics`, `sealed/make`, `referee/case`.
"""
