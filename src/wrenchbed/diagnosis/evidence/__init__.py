"""What each effect would add to each reading, and the exact evidence of each hypothesis.
Read first: `dictionary`, then `likelihood` and `search`.
Free: linear algebra; tests/diagnosis/test_likelihood compares it with dense formulas.
Others rely on: names of variables (change `_HINTS` of gap, actions of next with them); priors,
ladders, scales, steps, all odds: after a change of a constant run `scripts/learn_reliability`, then
new sealed cases (docs/how-to/sealed.md).
Never: refit or judge; it is linear and knows no verdict.
"""
