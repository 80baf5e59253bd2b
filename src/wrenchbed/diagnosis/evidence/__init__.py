"""What each effect would add to each reading, and the exact evidence of each hypothesis.
Read first: `dictionary`, then `likelihood` and `search`.
Free: linear algebra; tests/diagnosis/test_likelihood compares it with dense formulas.
Others rely on: names of variables (gap, next); priors, ladders, scales, steps, all odds: after a
change of one of these constants `scripts/learn_reliability`, then sealed cases.
Never: refit or judge; it is linear and knows no verdict.
"""
