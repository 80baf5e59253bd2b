"""Structures of up to three effects, their nonlinear refit, claims, verdict, reliability.
Read first: `structures`, then `shared_numbers` and `refit`, `claims` and `verdict`.
Free: the inside of each file (search and numerics); tests/diagnosis/test_refit, test_claims and
test_elements speak.
Others rely on: lessons.jsonl with `reliability.NAMES` (`scripts/learn_reliability`), `Verdict`.
Never: the last word on a claim; `gap` measures it on held-out rows.
"""
