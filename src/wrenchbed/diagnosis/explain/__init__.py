"""Structures of up to three effects, their nonlinear refit, claims, verdict, reliability.
Read first: `structures`, then `shared_numbers` and `refit`, `claims` and `verdict`.
Free: speed and caches; tests/diagnosis/test_refit, test_claims and test_elements speak.
Others rely on: lessons.jsonl with `reliability.NAMES`, `Verdict`, `Refitter` (gap, several). What
moves probabilities (`_TRIALS`, `_RIDGE`, steps, odds) asks for `scripts/learn_reliability`.
Never: the last word on a claim; `gap` measures it on held-out rows.
"""
