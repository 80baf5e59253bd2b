"""What each effect would add to each reading, and the exact evidence of each hypothesis.
Read first: `dictionary`, then `likelihood` and `search`.
Free: linear algebra; tests/diagnosis/test_likelihood compares it with dense formulas.
Others rely on: priors, ladders, scales, all odds: after a change `scripts/learn_reliability`.
Never: refit or judge; it is linear and knows no verdict.
"""
